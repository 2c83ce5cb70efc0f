"""The constants of the estimate by sharp edges: one frozen object, a part for each module."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from deshake.blind.settings.candidates import (
    CandidateSettings,
    CourseSettings,
    EntrySettings,
    PolishSettings,
    RaceSettings,
    Refinement,
    Way,
)
from deshake.blind.settings.choosing_tiles import (
    Budget,
    TileChoiceSettings,
    TilePlanSettings,
    TilesSettings,
)
from deshake.blind.settings.early_answers import (
    BlurKindSettings,
    BoundsSettings,
    EdgeSpreadSettings,
    EstimateSettings,
    SharpnessSettings,
    SpectrumFitSettings,
)
from deshake.blind.settings.edge_fit import (
    KernelStepSettings,
    LatentPictureSettings,
    SharpEdgesSettings,
)
from deshake.blind.settings.judging import (
    AgreementSettings,
    FocalSearchSettings,
    JudgeSettings,
    KernelComparisonSettings,
    KernelFaultsSettings,
    RestoredTilesSettings,
    SpotSettings,
    TonesSettings,
    TrustSettings,
)
from deshake.blind.settings.lamps import (
    DrawnPathSettings,
    StreakFit,
    StreakLightSettings,
    StreaksSettings,
)
from deshake.blind.settings.paths import (
    CameraPathSettings,
    NarrowingSettings,
    PathScales,
    PathSearchSettings,
    SoftSceneSettings,
    SpectralMatchSettings,
    SpectralStartSettings,
    SpectrumTiles,
    TrimmingSettings,
)
from deshake.blind.settings.wide_kernels import (
    FrameWay,
    GrowthSettings,
    WideStartSettings,
    WideWay,
)

__all__ = [
    "SETTINGS",
    "Budget",
    "EdgesSettings",
    "FrameWay",
    "PathScales",
    "Refinement",
    "SpectrumTiles",
    "StreakFit",
    "Way",
    "WideWay",
]


@dataclass(frozen=True)
class EdgesSettings:
    """The constants of the estimate by sharp edges.

    Each part has the name of the module of `deshake/blind/` that uses it. The set `tune` of
    `bench.py shakes`, on which most of it was tuned, has 63 simulated photos: 43 that recorded
    hands shake by 3 to 120 px, 10 sharp, 5 soft, and 5 out of focus (`docs/inspect.md`).

    Parameters
    ----------
    bounds, estimate, sharpness, edge_spread, spectrum_fit, blur_kind
        The answers that need no kernel, and what becomes of the photo.
    tile_choice, tile_plan, tiles
        The tiles.
    sharp_edges, kernel_step, latent_picture
        The picture of edges, and the kernel.
    candidate, wide_start, growth, entry, course, race, polish
        The race.
    trimming, camera_path, soft_scene, narrowing, spectral_match, spectral_start, path_search
        The paths of a camera.
    judge, restored_tiles, kernel_comparison, tones, focal_search, agreement, spot
        What is thought of a kernel.
    kernel_faults, trust
        Its faults, and how reliable it is.
    streaks, streak_light, drawn_path
        The streaks of lamps.

    """

    bounds: BoundsSettings = field(default_factory=BoundsSettings)
    estimate: EstimateSettings = field(default_factory=EstimateSettings)
    sharpness: SharpnessSettings = field(default_factory=SharpnessSettings)
    edge_spread: EdgeSpreadSettings = field(default_factory=EdgeSpreadSettings)
    spectrum_fit: SpectrumFitSettings = field(default_factory=SpectrumFitSettings)
    blur_kind: BlurKindSettings = field(default_factory=BlurKindSettings)
    tile_choice: TileChoiceSettings = field(default_factory=TileChoiceSettings)
    tile_plan: TilePlanSettings = field(default_factory=TilePlanSettings)
    tiles: TilesSettings = field(default_factory=TilesSettings)
    sharp_edges: SharpEdgesSettings = field(default_factory=SharpEdgesSettings)
    kernel_step: KernelStepSettings = field(default_factory=KernelStepSettings)
    latent_picture: LatentPictureSettings = field(default_factory=LatentPictureSettings)
    candidate: CandidateSettings = field(default_factory=CandidateSettings)
    wide_start: WideStartSettings = field(default_factory=WideStartSettings)
    growth: GrowthSettings = field(default_factory=GrowthSettings)
    entry: EntrySettings = field(default_factory=EntrySettings)
    course: CourseSettings = field(default_factory=CourseSettings)
    race: RaceSettings = field(default_factory=RaceSettings)
    polish: PolishSettings = field(default_factory=PolishSettings)
    trimming: TrimmingSettings = field(default_factory=TrimmingSettings)
    camera_path: CameraPathSettings = field(default_factory=CameraPathSettings)
    soft_scene: SoftSceneSettings = field(default_factory=SoftSceneSettings)
    narrowing: NarrowingSettings = field(default_factory=NarrowingSettings)
    spectral_match: SpectralMatchSettings = field(default_factory=SpectralMatchSettings)
    spectral_start: SpectralStartSettings = field(default_factory=SpectralStartSettings)
    path_search: PathSearchSettings = field(default_factory=PathSearchSettings)
    judge: JudgeSettings = field(default_factory=JudgeSettings)
    restored_tiles: RestoredTilesSettings = field(default_factory=RestoredTilesSettings)
    kernel_comparison: KernelComparisonSettings = field(default_factory=KernelComparisonSettings)
    tones: TonesSettings = field(default_factory=TonesSettings)
    focal_search: FocalSearchSettings = field(default_factory=FocalSearchSettings)
    agreement: AgreementSettings = field(default_factory=AgreementSettings)
    spot: SpotSettings = field(default_factory=SpotSettings)
    kernel_faults: KernelFaultsSettings = field(default_factory=KernelFaultsSettings)
    trust: TrustSettings = field(default_factory=TrustSettings)
    streaks: StreaksSettings = field(default_factory=StreaksSettings)
    streak_light: StreakLightSettings = field(default_factory=StreakLightSettings)
    drawn_path: DrawnPathSettings = field(default_factory=DrawnPathSettings)


SETTINGS: Final = EdgesSettings()
