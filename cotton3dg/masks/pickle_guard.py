"""Weights that are pickles: reading one may run any program, so the user has to vouch for it."""

from ..errors import BadUsage


def demand_trust(name: str, trusted: bool, instead: str) -> None:
    """Raise BadUsage unless the user trusts the weights.

    Args:
        name: of the file or folder. instead: what to use otherwise, for the message.
    """
    if not trusted:
        raise BadUsage(
            f"{name} is a pickle, which can run any program when it is read; if you trust where it is from add "
            f"--trust-weights, or {instead}"
        )
