# SPDX-License-Identifier: Apache-2.0
"""SAM, SAM 2 and Grounding DINO of a few thousand random weights, saved as transformers saves the real ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

SIDE = 128
PROMPTS = {"hidden_size": 32, "image_size": SIDE, "patch_size": 16, "mask_input_channels": 4}
DECODER = {
    "hidden_size": 32,
    "mlp_dim": 64,
    "num_hidden_layers": 2,
    "num_attention_heads": 2,
    "iou_head_hidden_dim": 32,
}
VOCABULARY = ("[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", ".", "cotton", "boll")


def tiny_sam() -> Any:
    from transformers import SamConfig, SamModel

    vision = {
        "hidden_size": 32,
        "output_channels": 32,
        "num_hidden_layers": 2,
        "num_attention_heads": 2,
        "image_size": SIDE,
        "window_size": 4,
        "global_attn_indexes": [1],
        "num_pos_feats": 16,
        "mlp_dim": 64,
    }
    return SamModel(SamConfig(vision_config=vision, prompt_encoder_config=PROMPTS, mask_decoder_config=DECODER))


def tiny_sam2() -> Any:
    from transformers import Sam2Config, Sam2Model

    backbone = {
        "model_type": "sam2_hiera_det_model",
        "hidden_size": 16,
        "num_attention_heads": 1,
        "image_size": [SIDE, SIDE],
        "window_positional_embedding_background_size": [2, 2],
        "blocks_per_stage": [1, 1, 2, 1],
        "embed_dim_per_stage": [16, 32, 64, 128],
        "num_attention_heads_per_stage": [1, 1, 2, 4],
        "window_size_per_stage": [4, 2, 4, 4],
        "global_attention_blocks": [3],
    }
    vision = {
        "backbone_config": backbone,
        "backbone_channel_list": [128, 64, 32, 16],
        "backbone_feature_sizes": [[32, 32], [16, 16], [8, 8]],
        "fpn_hidden_size": 32,
    }
    return Sam2Model(Sam2Config(vision_config=vision, prompt_encoder_config=PROMPTS, mask_decoder_config=DECODER))


def tiny_grounding_dino() -> Any:
    from transformers import GroundingDinoConfig, GroundingDinoForObjectDetection

    backbone = {
        "model_type": "swin",
        "embed_dim": 16,
        "depths": [1, 1, 1, 1],
        "num_heads": [1, 1, 2, 2],
        "window_size": 4,
        "image_size": 64,
        "out_features": ["stage2", "stage3", "stage4"],
    }
    text = {
        "model_type": "bert",
        "vocab_size": len(VOCABULARY),
        "hidden_size": 32,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
        "intermediate_size": 32,
        "max_position_embeddings": 64,
    }
    halves = {
        f"{half}_{name}": number
        for half in ("encoder", "decoder")
        for name, number in (("layers", 2), ("ffn_dim", 32), ("attention_heads", 2))
    }
    config = GroundingDinoConfig(
        backbone_config=backbone, text_config=text, d_model=32, num_queries=20, max_text_len=16, **halves
    )
    return GroundingDinoForObjectDetection(config)


def save(folder: Path, kind: str) -> Path:
    """A model of a `model_type` in a folder, with the tokenizer that it needs."""
    import torch
    from transformers import BertTokenizerFast

    torch.manual_seed(0)
    model = {"sam": tiny_sam, "sam2": tiny_sam2, "grounding-dino": tiny_grounding_dino}[kind]()
    model.save_pretrained(folder)
    if kind == "grounding-dino":
        (folder / "vocab.txt").write_text("\n".join(VOCABULARY))
        BertTokenizerFast(vocab_file=str(folder / "vocab.txt")).save_pretrained(folder)
    return folder
