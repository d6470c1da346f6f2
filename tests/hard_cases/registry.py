# SPDX-License-Identifier: Apache-2.0
"""The numbered hard cases: what each promises and which tests show it.

A number never changes its meaning; new cases get new numbers. `make hard-cases` runs the tests and prints the table.
"""

from __future__ import annotations

from dataclasses import dataclass

CORE, GEOMETRY = range(1, 30), range(30, 39)
"""Numbers that have to be tested, as do 53 and 54; those between may wait for the issue that builds them."""


@dataclass(frozen=True)
class Case:
    """One way to break a pipeline from video to traits."""

    number: int
    name: str
    promise: str
    tests: tuple[str, ...]
    """Test functions, as pytest names them, without parameters."""
    planned: str = ""
    """What is still to come, and the issue that brings it."""


SCENES = "tests/property/test_scenes.py::"
RELATIONS = "tests/property/test_relations.py::"
PROJECTION = "tests/hard_cases/test_core_projection.py::"
BLENDING = "tests/hard_cases/test_core_blending.py::"
TRAINING = "tests/hard_cases/test_core_training.py::"
GRADIENTS = "tests/native/test_gradients.py::"
POINTS = "tests/hard_cases/test_geometry.py::"
SFM = "tests/hard_cases/test_sfm_failures.py::"
PROBABILITY = "tests/unit/segment/test_probability.py::"
COLMAP = "tests/unit/io/test_colmap.py::"
VIDEO = "tests/unit/io/test_video.py::"
IMAGES = "tests/unit/io/test_images.py::"
RESUME = "tests/hard_cases/test_resume.py::"
WORKSPACE = "tests/unit/test_workspace.py::"
FOLDERS = "tests/hard_cases/test_hostile_folders.py::"
KILLS = "tests/hard_cases/test_killed_runs.py::"
CLIPS = "tests/hard_cases/test_damaged_clips.py::"
SAVES = "tests/hard_cases/test_interrupted_saves.py::"
FUZZ = "tests/property/test_readers.py::test_mutated_files_end_in_a_result_or_in_our_own_error"

CASES = (
    Case(1, "duplicate SfM points", "scales have a finite floor, and training from them works", (
        "tests/unit/train/test_initialise.py::test_identical_points_have_finite_scales",
        "tests/unit/train/test_initialise.py::test_duplicates_and_outliers_among_good_points_keep_to_the_typical_scale",
        TRAINING + "test_case_01_a_hundred_identical_points_can_be_trained_from",
    )),
    Case(2, "infinite scale", "that Gaussian is culled and counted, the others are drawn to the same bits", (
        PROJECTION + "test_case_02_infinite_scale_is_culled_and_counted",
        SCENES + "test_poison_grid",
        SCENES + "test_poison_grid_of_colours",
        TRAINING + "test_case_02_culled_gaussians_are_counted_in_the_stages_record",
    )),
    Case(3, "overflow of a log scale, squared", "log scales are clamped to ±30; finite from -90 to 90 and beyond", (
        PROJECTION + "test_case_03_any_log_scale_is_drawn_and_only_free_ones_have_a_gradient",
        PROJECTION + "test_case_03_the_clamp_is_continuous",
        SCENES + "test_valid_extremes_stay_visible",
    )),
    Case(4, "needles whose determinant cancels", "as in double: the determinant is a sum of squares", (
        PROJECTION + "test_case_04_needles_match_double",
        GRADIENTS + "test_float_matches_double",
        SCENES + "test_random_scenes_in_float_match_double",
    )),
    Case(5, "near plane fixed in metres", "the near plane and training scale with the scene", (
        PROJECTION + "test_case_05_the_near_plane_scales_with_the_scene",
        "tests/unit/train/test_trainer.py::test_the_size_of_the_scene_does_not_matter",
        RELATIONS + "test_scaling_the_scene_by_a_power_of_two_changes_no_bit_of_what_can_be_scaled",
        RELATIONS + "test_scaling_in_double_leaves_only_the_rounding_of_the_logarithm",
        RELATIONS + "test_turning_the_world_changes_next_to_nothing",
    )),
    Case(6, "Gaussian at the camera centre", "culled, counted, no gradient", (
        PROJECTION + "test_case_06_a_gaussian_at_the_camera_centre_is_culled_without_gradient",
    )),
    Case(7, "Jacobian frozen beyond the frustum", "the gradient is that of the frozen forward", (
        PROJECTION + "test_case_07_the_gradient_is_that_of_the_frozen_jacobian",
        GRADIENTS + "test_image_and_gradients_match_autograd",
    )),
    Case(8, "zero or tiny quaternion", "zero is culled and counted; length changes nothing and is differentiated", (
        PROJECTION + "test_case_08_a_zero_quaternion_is_culled_and_counted",
        PROJECTION + "test_case_08_the_length_of_a_quaternion_changes_nothing",
        GRADIENTS + "test_gradients_match_finite_differences",
    )),
    Case(9, "min(0.99, NaN) hides a NaN", "culled before blending and counted, in every slot", (
        BLENDING + "test_case_09_nan_is_not_hidden_by_the_cap",
        SCENES + "test_random_poisoned_scenes_stay_finite",
    )),
    Case(10, "another alpha cap backward than forward", "one constant, one function", (
        BLENDING + "test_case_10_forward_and_backward_have_one_alpha_cap",
        BLENDING + "test_case_10_the_cap_is_that_of_the_reference",
    )),
    Case(11, "saturated alpha passes gradient", "none beyond the cap", (
        BLENDING + "test_case_11_a_saturated_alpha_has_no_gradient",
    )),
    Case(12, "division by 1 - alpha drifts", "16 stacked Gaussians: float within 1e-4 of double", (
        BLENDING + "test_case_12_sixteen_stacked_gaussians_keep_float_near_double",
        BLENDING + "test_case_12_a_stack_of_opaque_gaussians_ends_a_pixel",
    )),
    Case(13, "backward visits other Gaussians than forward", "exactly the same ones", (
        BLENDING + "test_case_13_backward_visits_exactly_what_forward_blended",
    )),
    Case(14, "background counted twice", "the gradient is that of autograd for any background", (
        BLENDING + "test_case_14_the_background_counts_once",
    )),
    Case(15, "equal depths, NaN as sort key", "order by (depth, row); what is not finite never gets a key", (
        BLENDING + "test_case_15_of_two_equal_depths_the_first_row_is_in_front",
        BLENDING + "test_case_15_many_equal_depths_are_drawn_in_row_order",
        BLENDING + "test_case_15_poisoned_depths_never_reach_the_sort",
        RELATIONS + "test_permuting_gaussians_of_distinct_depth_changes_no_bit",
    )),
    Case(16, "3-sigma cut shows tile edges", "no pixel depends on where the tiles and blocks lie", (
        BLENDING + "test_case_16_no_tile_or_block_edge_shows",
        BLENDING + "test_case_16_float_has_no_edges_either",
    )),
    Case(17, "log(255 opacity) of a faint Gaussian", "below 1/255 culled and counted", (
        PROJECTION + "test_case_17_opacity_below_the_cut_is_culled_and_counted",
    )),
    Case(18, "opacity reset kills the scene", "recovers; what fades is pruned and counted", (
        TRAINING + "test_case_18_faded_or_reset_opacities_recover",
    )),
    Case(19, "SSIM of flat or tiny images", "at most 1, gradient finite", (
        TRAINING + "test_case_19_ssim_of_flat_and_tiny_images",
        GRADIENTS + "test_loss_matches_autograd",
    )),
    Case(20, "nothing visible", "the background, no gradient, no step", (
        PROJECTION + "test_case_20_nothing_visible_gives_the_background",
    )),
    Case(21, "odd image sizes", "exact to the last row and column, 1x1 to 257x257", (
        PROJECTION + "test_case_21_images_of_any_size_are_exact",
    )),
    Case(22, "mask empty, full or of another size", "empty and full are answers; another size is refused by name", (
        TRAINING + "test_case_22_masks_that_are_empty_full_or_of_another_size",
        "tests/end_to_end/test_segment_cluster.py::test_no_bolls_is_an_answer",
        "tests/end_to_end/test_segment_cluster.py::test_wrong_masks_and_missing_inputs_are_named",
    )),
    Case(23, "binary cross-entropy at 0 and 1", "finite, clamped after the step, never stuck", (
        PROBABILITY + "test_cross_entropy_is_finite_at_the_ends",
        PROBABILITY + "test_flipped_labels_recover",
        PROBABILITY + "test_masks_without_sense_give_probabilities_all_the_same",
    )),
    Case(24, "normalising a zero feature", "stays zero, without gradient", (
        TRAINING + "test_case_24_features_without_direction_stay_zero_without_gradient",
    )),
    Case(25, "Adam's epsilon turns noise into full steps", "only what a view shows moves, within Adam's bound", (
        TRAINING + "test_case_25_no_step_of_adam_is_longer_than_its_bound",
        TRAINING + "test_case_25_the_first_steps_of_a_late_band_are_no_longer_than_its_rate",
        TRAINING + "test_case_25_a_gradient_that_is_not_finite_stops_its_own_gaussian_only",
        TRAINING + "test_case_25_what_a_view_does_not_show_does_not_move",
        TRAINING + "test_case_25_steps_far_away_keep_their_limit",
        TRAINING + "test_case_25_longest_gradients_leave_finite_moments",
    )),
    Case(26, "densification explosion", "hard budgets, 64-bit counts, a clear error before memory is taken", (
        TRAINING + "test_case_26_more_pairs_than_memory_are_an_error_not_a_crash",
        TRAINING + "test_case_26_the_limit_follows_the_memory_there_is",
        TRAINING + "test_case_26_the_memory_there_is_is_read_as_the_system_tells_it",
        TRAINING + "test_case_26_the_budget_holds_when_everything_wants_to_split",
        "tests/unit/train/test_densify.py::test_the_budget_is_never_exceeded",
    )),
    Case(27, "NaN in sampling weights", "finite and not negative; poisoned ones choose nothing", (
        TRAINING + "test_case_27_poisoned_statistics_choose_nothing",
        "tests/unit/train/test_densify.py::test_poisoned_needs_and_gaussians_are_never_chosen",
    )),
    Case(28, "-ffast-math removes isnan", "forbidden, and noticed at import", (
        TRAINING + "test_case_28_fast_math_is_forbidden",
        TRAINING + "test_case_28_the_import_time_self_test_notices_fast_math",
    )),
    Case(29, "sums depend on the thread count", "the same bits for 1 to 16 threads", (
        RELATIONS + "test_one_hash_for_any_number_of_threads_and_ten_runs",
        RELATIONS + "test_one_hash_for_a_whole_training_run_ten_times",
        TRAINING + "test_case_29_training_does_not_depend_on_threads",
    )),
    Case(30, "hull of < 4, flat, collinear, duplicate points", "blank cell and reason, never a joggled volume", (
        POINTS + "test_case_30_degenerate_sets_have_a_reason_and_no_volume",
        POINTS + "test_case_30_empty_set",
        POINTS + "test_case_30_flat_in_float32_is_flat",
        POINTS + "test_case_30_duplicates_do_not_change_a_volume",
        POINTS + "test_case_30_the_blank_cell_says_why",
    )),
    Case(31, "hull far from the origin in float32", "centred first, float64", (
        POINTS + "test_case_31_volume_far_from_the_origin",
        POINTS + "test_case_31_volume_scales_with_the_cube",
    )),
    Case(32, "flat or symmetric set in an oriented box", "rank-aware, sorted axes, ties reported", (
        POINTS + "test_case_32_boxes_of_symmetric_and_flat_sets",
        POINTS + "test_case_32_rectangles_of_flat_sets",
    )),
    Case(33, "DBSCAN on nothing, one point, another order", "0 bolls is an answer; the order changes nothing", (
        POINTS + "test_case_33_clustering_nothing_gives_no_bolls",
        POINTS + "test_case_33_one_point_is_no_boll_and_no_error",
        POINTS + "test_case_33_another_order_of_gaussians_and_masks_gives_the_same_bolls",
    )),
    Case(34, "RANSAC plane: 2 points, two tables, ties", "seeded, bounded, the same table each time", (
        POINTS + "test_case_34_two_points_are_no_plane",
        POINTS + "test_case_34_not_finite_points_are_left_out",
        POINTS + "test_case_34_of_two_tables_the_higher_one_is_taken",
        POINTS + "test_case_34_a_grid_of_exact_ties_is_decided_the_same_way_each_time",
        POINTS + "test_case_34_cameras_all_in_one_place",
    )),
    Case(35, "zero or absurd scale", "no scale and a reason; metric cells stay blank", (
        POINTS + "test_case_35_a_table_without_area_gives_no_scale",
        POINTS + "test_case_35_absurd_units_stay_finite",
        POINTS + "test_case_35_a_scale_file_without_a_usable_scale_is_refused",
        "tests/end_to_end/test_traits_stage.py::test_without_a_scale_metric_cells_are_blank",
    )),
    Case(36, "wrong sub-model chosen", "the largest; refused below 40 % of the images; the rest is reported", (
        SFM + "test_case_36_of_two_places_the_one_with_more_images_is_taken_and_the_rest_is_told",
        SFM + "test_case_36_models_are_ordered_by_images_then_points",
        SFM + "test_case_36_a_small_share_of_the_images_is_refused",
    )),
    Case(37, "no initial pair, one plane, wrong focal length", "right, or exit code 4 with advice", (
        SFM + "test_case_37_no_initial_pair",
        SFM + "test_case_37_a_wrong_focal_length_is_corrected_or_refused",
        SFM + "test_case_37_a_scene_that_is_one_plane_is_right_or_refused",
        SFM + "test_case_37_one_image_over_and_over",
    )),
    Case(38, "NaN poses in model files", "the view is dropped with a warning", (
        SFM + "test_case_38_a_model_of_lost_poses_only_is_refused",
        COLMAP + "test_image_without_finite_pose_is_left_out_with_a_warning",
        COLMAP + "test_points_that_are_not_finite_are_left_out",
    )),
    Case(39, "damaged video on which ffmpeg exits 0", "decoded frames are counted, never silent", (
        VIDEO + "test_truncated_clip_shows_what_is_left",
        VIDEO + "test_bit_rot_is_noticed_and_ends_at_a_key_frame",
        "tests/end_to_end/test_frames.py::test_half_of_a_clip_is_refused_and_most_of_it_flagged",
        "tests/hard_cases/test_broken_video.py::test_a_broken_video_runs_through_and_every_defect_is_told",
        CLIPS + "test_case_39_a_clip_cut_off_anywhere_is_flagged_or_refused",
        CLIPS + "test_case_39_bit_rot_never_gives_frames_of_nothing",
        CLIPS + "test_case_39_rot_in_a_fifth_of_the_frames_is_never_taken_for_sound",
        CLIPS + "test_case_39_what_is_no_film_is_refused",
        CLIPS + "test_case_39_a_film_without_pictures_is_refused",
    )),
    Case(40, "variable frame rate", "timestamps, never frame counts", (
        VIDEO + "test_variable_frame_rate_keeps_true_times",
        "tests/unit/frames/test_keyframe_buffer.py::test_lingering_does_not_double_views_and_hurrying_does_not_tear_the_orbit",
        CLIPS + "test_case_40_to_42_odd_formats_are_read_as_they_are",
    )),
    Case(41, "rotation tag, EXIF orientation", "applied to the pixels, recorded", (
        VIDEO + "test_rotation_tag_is_applied",
        IMAGES + "test_exif_orientation_is_applied",
        CLIPS + "test_case_41_a_turned_clip_comes_out_upright",
    )),
    Case(42, "HDR and 10 bit", "tone-mapped, recorded", (
        VIDEO + "test_hdr_is_tone_mapped",
        VIDEO + "test_ten_bit_standard_range_is_left_as_filmed",
        CLIPS + "test_case_40_to_42_odd_formats_are_read_as_they_are",
    )),
    Case(43, "truncated JPEG decodes half", "refused at every length", (
        IMAGES + "test_every_truncation_is_refused",
        "tests/end_to_end/test_frames.py::test_truncated_photo_is_named",
    )),
    Case(44, "hostile file names", "only names, never options, patterns or commands", (
        VIDEO + "test_hostile_names_are_only_names",
        FOLDERS + "test_case_44_hostile_folders_are_only_folders",
        FOLDERS + "test_case_44_relative_names_that_look_like_options_reach_the_run_as_names",
    )),
    Case(45, "hostile PLY", "sizes checked before memory is taken, values checked", (
        "tests/unit/io/test_ply.py::test_hostile_files_are_refused",
        FUZZ,
    )),
    Case(46, "hostile NPZ and checkpoint", "no pickle, no bombs, sizes checked before memory is taken", (
        "tests/hard_cases/test_arrays.py::test_case_46_objects_bombs_and_absurd_sizes_are_refused",
        "tests/hard_cases/test_arrays.py::test_case_46_nothing_is_ever_unpickled",
        RESUME + "test_case_51_a_checkpoint_of_something_else_or_a_damaged_one_is_not_used",
        FUZZ,
    )),
    Case(47, "image bomb", "own limit, before decoding", (
        IMAGES + "test_image_bomb_is_refused_before_decoding",
        FUZZ,
    )),
    Case(48, "CSV formula injection", "text is prefixed, negative numbers stay numbers", (
        "tests/hard_cases/test_csv.py::test_case_48_formulas_are_prefixed",
        "tests/hard_cases/test_csv.py::test_case_48_negative_numbers_stay_numbers",
        "tests/hard_cases/test_csv.py::test_case_48_flags_are_guarded_too",
    )),
    Case(49, "killed while saving", "the old result or the new one, never a part", (
        WORKSPACE + "test_a_failed_save_keeps_the_old_result",
        "tests/unit/test_pipeline.py::test_damage_is_noticed_and_repaired",
        SAVES + "test_case_49_killed_at_any_boundary_the_result_is_the_old_or_the_new_one",
        KILLS + "test_case_49_killed_at_any_write_boundary_of_any_stage_a_result_is_whole",
        KILLS + "test_case_49_killed_at_random_the_results_are_those_of_an_undisturbed_run",
    )),
    Case(50, "disk full", "the old file stays; a clear error", (
        WORKSPACE + "test_disk_errors_are_explained",
        SAVES + "test_case_50_a_disk_that_is_full_at_any_boundary_is_told_and_costs_nothing_old",
        WORKSPACE + "test_whatever_a_library_says_on_a_full_disk_is_explained",
        "tests/unit/test_resource_checks.py::test_a_stage_that_the_disk_has_no_room_for_does_not_start_and_keeps_its_result",
        "tests/hard_cases/test_full_disk.py::"
        "test_case_50_on_a_full_disk_a_stage_ends_with_a_reason_and_the_old_result_stays",
    )),
    Case(51, "resume differs from a straight run", "the same bits from any step on one machine and build", (
        RESUME + "test_case_51_resume_from_any_step_ends_in_the_same_bits",
        RESUME + "test_case_51_killed_in_training_the_next_run_goes_on_and_ends_in_the_same_bits",
        RESUME + "test_case_51_other_options_or_images_never_continue_a_training",
    )),
    Case(52, "two processes, one folder", "the second leaves with a message; a dead holder holds nothing", (
        WORKSPACE + "test_the_lock_excludes_and_dies_with_its_holder",
        "tests/unit/test_pipeline.py::test_a_second_process_is_turned_away",
        FOLDERS + "test_case_52_in_a_hundred_races_whoever_is_in_is_alone",
        FOLDERS + "test_case_52_of_two_runs_of_one_plant_one_is_turned_away_or_waits",
    )),
    Case(53, "options at their ends, intervals of zero", "the ends work, what lies beyond is refused by name", (
        "tests/hard_cases/test_option_bounds.py::"
        "test_case_53_the_bound_is_accepted_and_what_lies_beyond_is_refused",
        "tests/hard_cases/test_option_bounds.py::test_case_53_numbers_that_are_not_finite_are_refused",
        "tests/hard_cases/test_option_bounds.py::test_case_53_every_number_has_a_lower_bound",
        "tests/hard_cases/test_option_bounds.py::"
        "test_case_53_holding_out_every_zeroth_or_first_image_leaves_something_to_train_on",
        "tests/hard_cases/test_option_bounds.py::test_case_53_the_shortest_trainings_end",
        "tests/hard_cases/test_option_bounds.py::test_case_53_the_smallest_budget_is_that_of_the_start",
    )),
    Case(54, "loss that is not finite, for no known cause", "the step is undone, its inputs kept, training goes on", (
        RESUME + "test_case_54_a_step_that_is_not_finite_changes_nothing",
        RESUME + "test_case_54_training_goes_on_and_keeps_what_the_step_was_given",
        RESUME + "test_case_54_too_many_such_steps_end_the_stage_with_the_reason_and_the_evidence",
        "tests/unit/train/test_trainer.py::test_steps_with_a_non_finite_loss_are_counted_with_their_image",
    )),
    Case(55, "memory limit reached", "exit code 7 and what to do, before the start where it can be known", (
        "tests/unit/test_resource_checks.py::test_case_55_a_limit_that_is_too_low_for_anything_is_told_before_the_start",
        "tests/unit/test_resource_checks.py::test_case_55_memory_that_runs_out_in_a_stage_is_told",
        "tests/unit/test_resource_checks.py::test_running_out_of_memory_is_known_whichever_library_says_it",
    )),
)  # fmt: skip
