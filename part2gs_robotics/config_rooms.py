"""Settings of every room; the string under a field is its flag's help."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NewType

Preset = Literal["draft", "standard", "high"]
Material = NewType("Material", str)  # a name or a number that `materials.density_of` knows


@dataclass(frozen=True)
class ReadConfig:
    """What the readers may change, and what photos do not show."""

    max_side: int = 512
    """longest image side in pixels; larger images are downscaled in memory"""
    crop: bool = True
    """cut images larger than that round the object first, so that its pixels are kept"""
    allow_missing: bool = False
    """go on when images have no camera, or cameras have no image"""
    invert_masks: bool = False
    """masks are white on the background instead of on the object"""
    depth: bool = True
    """use depth images where the scene has them"""
    align: bool = False
    """carry state 1 onto state 0 on what stayed, where they are slightly out of one frame"""
    scale: float | None = None
    """metres per scene unit, if known"""
    known_length: float | None = None
    """metres of the object's longest side in its more compact state, instead of a scale"""
    material: Material | None = None
    """what the object is made of: kg/m3 or a name such as hardwood; absent: 600 kg/m3"""
    up: tuple[float, float, float] | None = None
    """up direction of the scene's world as three numbers, if known"""


@dataclass(frozen=True)
class PhotosConfig:
    """Plain photos, before there is a scene."""

    side: int = 1024
    """longest side of plain photos used, pixels"""
    frames: int = 40
    """frames taken from a video"""
    marker_size: float = 0.06
    """metres of a printed marker's black square, as measured"""
    mask_model: str | None = None
    """ONNX file of a salient-object network, which makes the masks of plain photos"""


@dataclass(frozen=True)
class FitConfig:
    """Gaussians of each state."""

    steps: int = 1600
    """optimiser steps per state, one view each"""
    half_steps: int = 300
    """first of these steps, at half the image resolution"""
    start_gaussians: int = 14_000
    """Gaussians on the visual hull at the start"""
    max_gaussians: int = 24_000
    """most Gaussians per state"""
    hull_resolution: int = 192
    """voxels along the longest side of the visual hull"""
    alpha_weight: float = 0.5
    """weight of the mean absolute error of the mask"""
    opacity_weight: float = 0.01
    """weight of the mean of o (1 - o), which drives opacities to 0 or 1"""
    depth_weight: float = 0.2
    """weight of mean log(1 + depth error / diagonal), used only with depth images"""
    smooth_weight: float = 0.5
    """weight of jumps and bends in depth where a photo shows no edge, without depth images"""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """where to render; auto: on CUDA where a GPU and gsplat are ready, else on the CPU"""
    view_color: bool = True
    """try colours that depend on the view; kept only if held-out views gain by them"""
    seed: int = 0
    """seed of every random choice; CPU builds repeat bit for bit"""


@dataclass(frozen=True)
class StereoConfig:
    """Depth from photos inside the visual hull, where a scene has no depth images."""

    stereo: bool = True
    """look into hollows by stereo; off: a fit starts from the visual hull alone"""
    stereo_views: int = 64
    """photos per state that get a depth map; more see nothing new"""
    stereo_side: int = 110
    """pixels of the object's longer side in these photos"""
    plain_faces: bool = False
    """put flat faces without texture where photos see their rims; looks through glass"""


@dataclass(frozen=True)
class SearchConfig:
    """How closely surfaces and photos are looked at for motion."""

    surfel_size: float = 0.01
    """size of a surface element, as a share of the object's diagonal"""
    patches: int = 22
    """pieces of moved surface whose motion is searched"""
    patch_points: int = 80
    """points of each that rank 100,000 motions"""
    proof_views: int = 12
    """photos per state that judge how many parts move"""
    proof_side: int = 256
    """their longest side in pixels"""
    align_views: int = 32
    """photos per state that joints are aligned to"""
    align_side: int = 256
    """their longest side in pixels"""
    sharp_side: int = 512
    """their longest side in the last alignment"""


@dataclass(frozen=True)
class ArticulateConfig:
    """Parts and joints."""

    parts: int | None = None
    """number of moving parts; searched when absent"""
    paper_mode: bool = False
    """every term that is on exactly as the paper prints it, instead of the corrected one"""
    identity: bool = True
    """neighbours and both states share out the parts; off: the motion that lands a point best"""
    articulation: bool = False
    """pull joints by matched points and the rigid turn of their pairs"""
    repel: bool = False
    """push parts away from the seam with the base by repel points"""
    contact: bool = True
    """pull joints so that parts do not enter the base on their way"""
    velocity: bool = False
    """pull joints so that the points of a part move as one body"""
    vector_field: bool = True
    """pull joints so that the points of a part land on the other state's surface"""
    alignment: bool = True
    """align joints to the images by second-order steps; never in paper mode"""
    seed: int = 0
    """seed of every random choice; CPU builds repeat bit for bit"""


@dataclass(frozen=True)
class MeshConfig:
    """Closed meshes of the parts."""

    resolution: int = 192
    """grid cells along the longest side of the object"""
    clearance_voxels: float = 1.0
    """gap kept between neighbouring parts, in grid cells"""
    flat_walls: bool = True
    """parts are solids of flat faces with sharp edges where photos show such"""
    free_range: bool = True
    """joints go as far as nothing is in the way; off: between the two photographed states"""
    collision_gap: float = 0.002
    """gap between pieces of two parts, share of the size; 2.2 mm at least, to 1 % of it; 0: none"""
    convex: bool = True
    """cut parts into convex collision pieces; off: one hull per part, hollows closed"""


@dataclass(frozen=True)
class TextureConfig:
    """Pictures of the parts' surfaces."""

    texture: bool = True
    """bake the photos into a texture per part; off: one colour per part"""
    texture_side: int = 1024
    """longest side of a part's texture in pixels"""


@dataclass(frozen=True)
class CheckConfig:
    """Simulator checks."""

    sweep_values: int = 21
    """joint values per joint at which interpenetration is measured"""


@dataclass(frozen=True)
class OutputConfig:
    """Where results go and what is said on the way."""

    out: str | None = None
    """output folder; default: SCENE_twin beside the scene"""
    preset: Preset = "standard"
    """draft: quick look, standard: full quality, high: slow and finest"""
    view: bool = False
    """show Gaussians in the browser while they train, on this machine alone (extra `view`)"""
    quiet: bool = False
    """only warnings and errors"""
    verbose: bool = False
    """details of every stage"""
    json: bool = False
    """say the result as one JSON object, for programs"""
