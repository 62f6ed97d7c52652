"""Parameters of the geometric actor for videos.

Evaluate them with::

    articulate benchmark DATASET --modality video --actor geometric-video

The values were chosen by hand; where an object or a figure decided, the field names it. Change a
field, run the command and compare the records. Lengths in pixels refer to the crop that is
compared, not to the input video.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class FitLevel:
    """Resolution and robustness of one stage of the joint camera fit."""

    max_px: int
    """Longest side of the region [px]."""
    step_share: float
    """Steps, as a share of the expected errors."""
    blur_px: float
    """Blur before images are compared [px]."""
    cost_cap: float
    """Largest cost of a pixel, summed over its colours, 0 to 765."""
    rounds: int
    """Steps at most."""


@dataclass(frozen=True)
class SurfaceParameters:
    """Triangles of the parts and the motions that their shape suggests."""

    textured_edge_px: float = 12.0
    """A textured face with a longer edge is split in four, so that one colour per face suffices
    [px]."""
    max_face_splits: int = 4
    """Times that a face is split at most; each makes four faces of one."""
    samples: int = 4000
    """Points sampled on a part's surface; four times as many on its surroundings."""
    same_axis_rad: float = float(np.radians(4.0))
    """Candidate axes closer to each other than this are merged [rad]."""
    contact_share: float = 0.02
    """Points closer to another part than this share of the object's diagonal are in contact."""
    end_percent: float = 3.0
    """Percentage of a part's points that form one of its two ends along an axis."""


@dataclass(frozen=True)
class ImageParameters:
    """Regions and resolutions of the video."""

    min_change: float = 3.0
    """Differences up to this are never a change, 0 to 255."""
    speck_px: int = 5
    """Connected changes of fewer pixels are noise [px]."""
    max_enlargement: float = 2.0
    """Largest factor by which small regions are enlarged."""
    quick_px: int = 72
    """Longest side of the level that ranks the parts [px]."""
    quick_frames: int = 8
    """Frames of that level."""
    coarse_px: int = 112
    """Longest side of the level that compares candidate motions [px]."""
    coarse_frames: int = 12
    """Frames of that level."""
    fine_px: int = 224
    """Longest side of the level that refines the best motions [px]."""
    fine_frames: int = 14
    """Frames of that level."""
    max_frames: int = 40
    """Most frames of a level while searching; small regions allow more than the minimum."""
    report_px: int = 160
    """Longest side of the images in reports [px]."""
    report_frames: int = 5
    """Frames in an image of a report."""


@dataclass(frozen=True)
class CompositingParameters:
    """Cost of explaining each pixel of the video by the model."""

    pixel_cost_cap: float = 110.0
    """Largest cost of a pixel: sum of absolute differences of three colours, 0 to 765. Caps what
    the model lacks."""
    mismatch_weight: float = 0.35
    """Share of the cost of a static pixel that differs from the model."""
    slack_ratio: float = 4.0
    """Tolerance for static pixels where things move, in units of the usual difference where nothing
    moves."""
    min_slack: float = 3.0
    """Smallest such tolerance, 0 to 255."""
    min_thickness_px: float = 2.0
    """Thinner parts count as this thick: more positions would not meet their image more often
    [px]."""
    depth_tolerance: float = 1.002
    """A surface closer by less than this factor does not occlude."""


@dataclass(frozen=True)
class LightParameters:
    """Light of the object, estimated from its colours."""

    prior_strengths: tuple[float, float, float] = (0.5, 0.3, 0.2)
    """Prior of ambient light, light from the camera and from a distant lamp, as shares of the
    albedo."""
    prior_weight: float = 0.004
    """Weight of the prior against all pixels together."""
    min_pixels: int = 30
    """Fewer pixels do not determine the light."""
    rest_frames: int = 8
    """Frames tried as the frame in which all joints are at 0."""
    max_rest_residual: float = 0.01
    """Largest mean residual of such a frame, 0 to 1: 0.003 for a cabinet at rest, 0.017 for a
    laptop that is open by another angle."""
    max_pixels: int = 1500
    """Pixels used at most."""
    soft_residual: float = 0.02
    """Residuals above this are down-weighted, 0 to 1."""


@dataclass(frozen=True)
class SearchParameters:
    """Search of the position of a part in every frame."""

    turn_positions: int = 48
    """Positions on a full turn."""
    max_turn_positions: int = 144
    """The same for thin parts, which would otherwise miss their image between two positions."""
    fine_turn_positions: int = 120
    """The same when every frame is used."""
    slide_step_px: float = 1.6
    """Image motion between two positions of a slide [px]."""
    max_slide_positions: int = 61
    """Positions of a slide at most."""
    step_change_cost: float = 1e-3
    """Cost of a step between frames that differs by one position from the step before, as a share
    of the largest cost of all pixels of the part."""
    fine_change_share: float = 0.3
    """Factor on that cost where positions are dense and changes by one mean little."""
    max_step_change: int = 4
    """Larger changes of the step cost no more: a motion may start and stop at once [positions]."""
    motion_cost_share: float = 0.02
    """Cost of a step by one position, as a share of a change by one: keeps unseen parts at rest."""
    bend_cost: float = 5e-4
    """Cost of a position that is a pixel beside the mean of its neighbours, squared, as a share of
    the largest cost of the part's pixels: frames that show little follow the motion before and
    after."""
    max_bend_cost: float = 2e-2
    """Largest cost of one bend, the same share: motions start and stop."""
    slide_reach_share: float = 0.5
    """Farthest travel of a slide, as a share of the object's diagonal."""
    min_motion_px: float = 2.0
    """A motion of fewer pixels does not explain a video in which something changes [px]."""
    position_unit_px: float = 0.8
    """Image motion of one unit of a position [px]."""
    max_uniform_turns: float = 1.2
    """Longest uniform rotation that is searched [turns]."""
    still_poses: int = 13
    """Constant poses that a motion is compared with."""
    max_positions: int = 160
    """Positions at most when a path is searched again."""
    max_step_positions: int = 9
    """Largest step between two frames [positions]."""
    max_rest_distance_rad: float = 0.8
    """A rotation that never comes closer to the rest pose loses part of its score [rad]."""
    away_penalty: float = 0.5
    """That part, as a share of its gain."""
    jump_rad: float = 0.3
    """Smallest rotation between two frames that may be a jump [rad]."""
    jump_step_ratio: float = 4.0
    """A jump exceeds the median step by this factor."""
    jump_gap_frames: int = 3
    """Frames left out over which a rotation may continue without a jump."""


@dataclass(frozen=True)
class FitParameters:
    """Choice of the part and of its motion."""

    visible_parts: int = 6
    """Parts tried among those seen where something changes."""
    hidden_parts: int = 3
    """Parts tried among those that are hidden at rest."""
    bulk_penalty: float = 0.25
    """Share of the gain that a part as large as the object has to explain in addition."""
    seeds: int = 3
    """Best parts for which co-moving parts are sought."""
    light_rounds: int = 2
    """Times that the light is estimated from the moving part before candidates are compared."""
    shifted_candidates: int = 3
    """Rotations whose axis is shifted on the coarse level."""
    shift_rounds: int = 3
    """Times that it is shifted."""
    shift_px: tuple[float, ...] = (-2.0, -1.0, 0.0, 1.0, 2.0)
    """Shifts along each of two directions across the axis [px]."""
    coarse_candidates: int = 8
    """Candidates that are refined on the coarse level."""
    fine_candidates: int = 3
    """Candidates that are refined on the fine level."""
    same_axis_cos: float = 0.97
    """Cosine between axes that count as equal to an excluded one."""
    visible_motion_share: float = 0.25
    """A slide, or a hinge across the axis of symmetry, that explains this share of the cost of a
    static object is visible. Knobs and wheels of the data set have 0.17 at most, two drawers that
    were taken for knobs 0.37 and 0.64, a door 0.31."""


@dataclass(frozen=True)
class RefineParameters:
    """Refinement of axis, pivot and positions."""

    soft_colour: float = 24.0
    """Differences of a colour above this are down-weighted, 0 to 255."""
    converged: float = 2e-4
    """Relative decrease of the cost below which refinement stops."""
    min_derivative: float = 0.3
    """Colours that change by less with a step of a parameter are ignored, 0 to 255."""
    uniform_gain_share: float = 0.9
    """A uniform rotation of a round part is preferred if it has this share of the best gain."""
    jump_px: float = 8.0
    """A slide jumps that exceeds its usual step by this, as one does that is hidden at first
    [px]."""
    smooth_cost_ratio: float = 1.05
    """Cost of a path without jumps, relative to the path with jumps, up to which it is
    preferred."""
    new_motion_cost_ratio: float = 0.97
    """Relative cost below which the motion found in all frames is refined again."""
    tilted_axes: int = 3
    """Axes close to that of the best rotation that are tried."""
    max_tilt_rad: float = 0.45
    """Their largest deviation [rad]."""
    same_turn_rad: float = 0.02
    """Axes closer to each other than this are equal [rad]."""
    tilt_gain_share: float = 0.03
    """Share of the gain that an axis of the part, or of what it touches, may cost."""
    snap_gain_share: float = 0.01
    """Share of the gain that an axis along a direction of the object's shape may cost."""
    hinge_gain_share: float = 0.04
    """Share of the gain that a hinge must explain in addition to a slide."""


@dataclass(frozen=True)
class SymmetryParameters:
    """Parts that rotate about their axis of symmetry, such as knobs and wheels."""

    test_turns_rad: tuple[float, ...] = (0.7, 1.9, 2.8, 4.3)
    """Rotations after which a round part coincides with itself [rad]."""
    max_deviation: float = 0.12
    """Largest deviation from rotational symmetry of a round part, in radii."""
    visible_share: float = 0.06
    """Gain, as a share of the largest cost, below which a rotation about the part's own axis is
    preferred."""
    own_axis_gain_share: float = 0.5
    """Share of the best gain that such a rotation must have."""
    faint_share: float = 0.006
    """Gain, as a share of the largest cost, below which a motion is hardly visible."""
    min_faint_share: float = 0.02
    """Share of the cost of a static object from which a hardly visible motion is believed. Slides
    along the axis have 0.05 and more where levers of a toaster come down by six pixels, 0 for 19 of
    20 knobs and wheels, and 0.03 for one whose rotation has 0.14."""
    endless_rad: float = 2.0 * np.pi + 0.5
    """Rotation assumed for an endless joint in a video in which nothing is visible [rad]."""
    start_angles: int = 72
    """Angles at which a rotation estimated from surface marks may start."""
    outlier_ratio: float = 3.0
    """A part changes more than others if it exceeds the median change by this factor."""
    min_strength: float = 0.2
    """And by this standard deviation, 0 to 255."""
    max_pixels: int = 2000
    """Pixels of the part used at most."""
    min_pixels: int = 6
    """Fewer pixels do not determine a rotation."""
    angle_bins: int = 96
    """Bins of the angle around the axis."""
    ring_px: float = 1.5
    """Width of the rings around the axis [px]."""
    min_turn_rad: float = 0.3
    """Smallest uniform rotation that is tried [rad]."""
    max_turn_rad: float = 7.5
    """Largest [rad]."""
    turn_step_rad: float = 0.1
    """Step between them [rad]."""
    fine_turn_step_rad: float = 0.02
    """Step close to the best [rad]."""
    clear_share: float = 0.15
    """Share of what the median rotation leaves unexplained that the best one must explain."""
    full_turn_tolerance: float = 0.25
    """A full turn is preferred if it loses at most this share of the advantage of the best
    rotation."""
    beside_rad: float = 0.6
    """Distance from the best rotation at which the explanation must be worse [rad]."""
    max_beside_share: float = 0.6
    """Share of the advantage that may remain there. Blurred marks, or a shape that is not quite
    round, show that a part rotates but not how far."""
    nearly_all_share: float = 0.8
    """Or the best rotation explains this share of all changes."""
    margin_px: int = 8
    """Margin around the part [px]."""
    full_turn_rad: float = 2.0 * np.pi + 0.25
    """Rotations of at least this have no limits; many limited ones have nearly a full turn
    [rad]."""


@dataclass(frozen=True)
class PartParameters:
    """Choice of moving parts, co-moving parts and the parent."""

    in_place_share: float = 0.8
    """Share of the changes within the image of a part that rotates in place."""
    partly_in_place_share: float = 0.6
    """The same for a part that is mostly hidden by its holder."""
    small_volume_share: float = 0.05
    """Largest bounding box of such a part, as a share of the object's."""
    span_share: float = 0.6
    """The changes are at least this share as wide and as high as the part."""
    near_share: float = 0.03
    """Co-moving parts are closer to the moving part than this share of the object's diagonal."""
    decisive_cost: float = 50.0
    """Cost saved or added per pixel above which the images decide. Of 26 objects with their true
    joints, co-moving parts in view save 130 and more, other parts cost 850 and more."""
    closer_share: float = 0.01
    """Otherwise a part moves along if it is closer to the moving part than to all static parts by
    this share of the diagonal."""
    points: int = 3000
    """Points sampled on a part's surface."""
    states: int = 7
    """Positions of the joint at which distances are measured."""
    touching_percent: float = 0.5
    """Percentage of a part's points that touch its neighbour."""
    equal_gap_share: float = 0.03
    """Distances that differ by less than this share of the diagonal are equal."""
    swept_px: int = 320
    """Longest side of the image in which the swept region is rendered [px]."""
    swept_poses: int = 32
    """Poses along the travel that are rendered."""
    swept_margin_px: int = 4
    """Margin for edges and shadows [px of that image]."""
    min_residual_share: float = 0.05
    """Share of all changes that must remain for another joint to be sought."""
    min_residual_px: int = 150
    """And pixels that must remain [px]."""


@dataclass(frozen=True)
class CameraParameters:
    """Camera pose from the static pixels, and stabilization of the video."""

    levels_px: tuple[int, ...] = (80, 160, 240)
    """Longest side of the object, from coarse to fine [px]."""
    random_cameras: int = 96
    """Random cameras on the coarsest level."""
    refined_cameras: int = 3
    """Best of them that are refined."""
    rounds: int = 8
    """Steps of a refinement."""
    slope_share: float = 0.1
    """Finite difference, as a share of the step of a level."""
    blur_px: float = 1.0
    """Blur before images are compared [px]."""
    finer_step: float = 0.35
    """Step of a level, as a share of that of the level before."""
    min_gain: float = 0.08
    """Share by which another camera must explain the static pixels better; a search from the true
    one gains a little by fitting what the model lacks."""
    unsure_share: float = 0.12
    """Band around the expected object that may be object or background, as a share of its size."""
    min_pixels: int = 400
    """Fewer static pixels of the object do not determine the camera [px of the coarsest level]."""
    edge: float = 24.0
    """Change of brightness between neighbouring pixels from which motion is visible, 0 to 255."""
    min_spread: float = 10.0
    """The camera may have moved where such pixels deviate from their median by this, 0 to 255."""
    max_spread_ratio: float = 0.7
    """It has moved if stabilization reduces that deviation below this share."""


@dataclass(frozen=True)
class JointFitParameters:
    """Camera pose and joint motion estimated jointly."""

    camera_steps: tuple[float, ...] = (0.06, 0.06, 0.06, 0.02, 0.02, 0.04)
    """Expected error of the camera: rotations about the object's centre [rad], image position of
    the centre [tangent], logarithm of the distance."""
    turn_step_rad: float = 0.06
    """The same of a rotation [rad]."""
    slide_step_m: float = 0.03
    """The same of a slide [m]."""
    first_level: FitLevel = FitLevel(80, 1.0, 3.0, 400.0, 8)
    """Level for every motion that is tried; its blur and cap keep large errors differentiable."""
    levels: tuple[FitLevel, ...] = (
        FitLevel(80, 0.6, 2.0, 250.0, 6),
        FitLevel(160, 0.3, 1.5, 110.0, 6),
    )
    """Levels for the best motions, from coarse to fine."""
    frames: int = 8
    """Frames used."""
    visible_parts: int = 3
    """Parts tried among those seen where something changes."""
    hidden_parts: int = 1
    """Parts tried among those that are hidden at rest."""
    min_motions: int = 2
    """Motions that are always tried."""
    max_motions: int = 6
    """Motions tried at most, where none of the first explains the video well."""
    slope_share: float = 0.3
    """Finite difference, as a share of the steps."""
    soft_residual: float = 6.0
    """Differences below this are squared, above it absolute, 0 to 255."""
    damping_rounds: int = 4
    """Times that a step is shortened."""
    converged: float = 0.002
    """Relative decrease of the cost below which the optimization stops."""
    hint_gain: float = 0.05
    """Share by which another camera must explain the video better to be refined."""
    min_gain: float = 0.35
    """Share by which it must explain the video better to be used: where the right motion is not
    among those tried, a slightly wrong camera may explain a video better by a quarter."""
    good_cost: float = 5.0
    """Cost below which nothing large is unexplained."""
    clear_cost: float = 3.0
    """Cost under the nominal camera below which no other is sought: videos cost 1 to 3 under the
    true one, 11 and more under one that is off by 5 degrees with nothing static in view."""
    positions: int = 48
    """Positions tried in each frame."""
    passes: int = 2
    """Times that motions are sought, each under the camera found before."""
    same_axis_cos: float = 0.99
    """Cosine of axes that are equal."""
    same_pivot_m: float = 0.03
    """Distance of axes that are equal [m]."""


@dataclass(frozen=True)
class CriticParameters:
    """Rating of a predicted joint."""

    level_px: int = 144
    """Longest side of the region [px]."""
    level_frames: int = 12
    """Frames used."""
    positions: int = 61
    """Positions between the limits at which the part is sought."""
    better_ratio: float = 1.12
    """Another axis or kind of joint is better if it explains this many times as much."""
    edges_good: float = 0.75
    """Correlation of edges rated 10."""
    edges_bad: float = 0.25
    """Correlation of edges rated 0."""
    tracks_good: float = 0.08
    """Error of point tracks, as a share of their motion, rated 10."""
    tracks_bad: float = 0.6
    """Error of point tracks rated 0."""
    worse_cue_weight: float = 0.4
    """Weight of the worse cue: on small or plain parts one of the two has no data."""
    min_tracks: int = 12
    """Fewer point tracks are no cue."""
    min_track_motion_px: float = 2.0
    """Point tracks that move less are ignored [px]."""
    other_pivot_m: float = 0.03
    """An axis that passes farther from the predicted one is another [m]."""
    same_axis_rad: float = 0.2
    """Axes closer to each other than this are equal [rad]."""
    type_cap: float = 1.0
    """Highest rating of a joint of the wrong type."""
    axis_cap: float = 2.0
    """Of a wrong axis."""
    origin_cap: float = 3.0
    """Of a wrong origin."""
    limit_cap: float = 4.0
    """Of wrong limits; the graver the failure, the lower the cap."""
    marked_rating: float = 7.0
    """Lowest rating of a rotation that agrees with the marks on a round part."""
    marked_tolerance_rad: float = 0.3
    """Its largest deviation from them [rad]."""
    doubtful_rating: float = 1.5
    """Lowest rating of a joint that edges and tracks do not confirm, but that no other joint beats:
    one of the wrong type is worse."""
    neutral_rating: float = 3.0
    """Rating where the video neither supports nor contradicts the joint."""
    unseen_confidence: float = 0.1
    """Confidence of a joint whose motion is not visible in the video."""


@dataclass(frozen=True)
class StillParameters:
    """Joints compared with one image of the open object."""

    coarse_px: int = 128
    """Longest side of the region in which hypotheses are compared [px]."""
    fine_px: int = 256
    """Longest side in which the best ones are refined [px]."""
    background_tolerance: float = 18.0
    """Pixels that differ by less from the background belong to it, 0 to 255."""
    min_change_px: float = 12.0
    """Fewer wrong pixels contradict no joint [px of the coarse region]."""
    min_part_px: int = 12
    """Smaller parts are not compared [px of the coarse region]."""
    max_units: int = 10
    """Moving parts that are compared at most, the largest first."""
    rounds: int = 2
    """Times that each part is moved while the others stay."""
    turn_positions: int = 36
    """Positions on a full turn."""
    slide_step_px: float = 3.0
    """Step of a slide, in units of a position [px]."""
    slide_reach_px: float = 90.0
    """Farthest travel of a slide, in the same units [px]."""
    finer_steps: tuple[float, ...] = (-0.5, -0.25, 0.25, 0.5)
    """Steps around the best position, as shares of a step."""
    min_gain_share: float = 0.05
    """A part has moved if that explains this share of its pixels."""
    better_share: float = 0.05
    """Hypotheses are refined that explain this share of the part's pixels in addition."""
    most_left_share: float = 0.6
    """Share of the wrong pixels that may remain where the two joints differ."""
    min_replaced_px: float = 25.0
    """Wrong pixels that it must explain in addition [px of the fine region]."""
    steps: tuple[int, ...] = (-3, -2, -1, 1, 2, 3)
    """Steps of a position around that of a hypothesis."""
    pivot_steps_px: tuple[float, ...] = (8.0, 4.0, 2.0, 1.0, 0.5)
    """Shifts of a rotated part, from coarse to fine [px of the fine region]."""
    pivot_rounds: int = 6
    """Shifts of each size at most."""
    min_turn_rad: float = 0.1
    """A smaller rotation determines no pivot [rad]."""
    snap_share: float = 0.005
    """Share of the part's pixels that a shifted pivot must explain in addition."""
    max_unexplained_share: float = 0.25
    """Share of the object's pixels that may remain wrong; otherwise the image is not used, as one
    with a textured background."""
    slide_share: float = 0.1
    """Share of this advantage that a hinge must explain in addition to a slide."""
    refined: int = 6
    """Hypotheses that are refined."""
    confidence: float = 0.7
    """Confidence of a joint that the image determines."""


@dataclass(frozen=True)
class GeometricParameters:
    """All parameters of the geometric actor for videos, by stage.

    Tune and evaluate them with
    ``articulate benchmark DATASET --modality video --actor geometric-video``.
    """

    surface: SurfaceParameters = field(default_factory=SurfaceParameters)
    image: ImageParameters = field(default_factory=ImageParameters)
    compositing: CompositingParameters = field(default_factory=CompositingParameters)
    light: LightParameters = field(default_factory=LightParameters)
    search: SearchParameters = field(default_factory=SearchParameters)
    fit: FitParameters = field(default_factory=FitParameters)
    refine: RefineParameters = field(default_factory=RefineParameters)
    symmetry: SymmetryParameters = field(default_factory=SymmetryParameters)
    parts: PartParameters = field(default_factory=PartParameters)
    camera: CameraParameters = field(default_factory=CameraParameters)
    joint_fit: JointFitParameters = field(default_factory=JointFitParameters)
    critic: CriticParameters = field(default_factory=CriticParameters)
    still: StillParameters = field(default_factory=StillParameters)


PARAMETERS = GeometricParameters()
"""The parameters in use; the names below are its groups."""
SURFACE = PARAMETERS.surface
IMAGE = PARAMETERS.image
COMPOSITING = PARAMETERS.compositing
LIGHT = PARAMETERS.light
SEARCH = PARAMETERS.search
FIT = PARAMETERS.fit
REFINE = PARAMETERS.refine
SYMMETRY = PARAMETERS.symmetry
PARTS = PARAMETERS.parts
CAMERA = PARAMETERS.camera
JOINT_FIT = PARAMETERS.joint_fit
CRITIC = PARAMETERS.critic
STILL = PARAMETERS.still
