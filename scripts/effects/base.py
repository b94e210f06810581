"""The contract of an effect: its parameters, and what it may know of the scene and of a capture."""

from dataclasses import dataclass, field, replace

import numpy as np

FRESNEL_RISE = 0.96 / 0.04  # of the reflectance of glass, from straight to grazing
STAGES = ("scene", "lens", "shutter", "sensor", "processing")
PARTS = 144  # of the light that an effect spreads: square and 4 m^2
AFFECTED = ("geometry", "point_spread", "intensity")
PLACE = "place"  # the parameter that says which of several ORDERs an effect has


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter of an effect.

    unit       as in ``px``, ``deg``, ``m``, ``dn`` (grey levels of 8 bits) or ``1``
    lower, upper  bounds of what is physically sensible
    null       the value at which the effect does nothing
    matters    the smallest departure from null that is worth naming
    doc        what it is, in one sentence
    prior_sd   standard deviation of a prior about null, for what data may leave undetermined; None: no prior
    auxiliary  whether it only says how another parameter acts and does nothing by itself
    discrete   whether the image changes discontinuously with it: whole values are compared before a fit. Of an auxiliary one
               whole values are all there are, and no fit moves it
    """

    unit: str
    lower: float
    upper: float
    null: float
    matters: float
    doc: str
    prior_sd: float | None = None
    auxiliary: bool = False
    discrete: bool = False

    @property
    def is_choice(self):
        """Whether whole values are all there are: compared, never fitted."""
        return self.auxiliary and self.discrete


@dataclass(frozen=True)
class Scene:
    """What Blender renders: plates on the ground, their radiances, the light.

    plates       list of rig.plates.Plate
    white, black, ground, background  linear radiances under the nominal light
    light        None (even), or a dict of ``light_factor``
    highlight    None, or a dict of a glossy lamp, the parameters of ``highlight_radiance``
    ink_spread_m outward move of the boundaries of black, metres
    T_cam_mount  4 x 4; the camera's true pose is ``T_cam_mount @ T_cam_world``
    """

    plates: tuple
    white: float
    black: float
    ground: float
    background: float
    light: dict | None = None
    highlight: dict | None = None
    ink_spread_m: float = 0.0
    T_cam_mount: np.ndarray = field(default_factory=lambda: np.eye(4))

    def with_(self, **changes):
        """Return a copy with some fields changed."""
        return replace(self, **changes)


@dataclass(frozen=True)
class Windows:
    """Which pixels of a frame an array shows that is put together of windows.

    x, y     (rows, columns) float32, frame pixels
    frame    slices of the array where the whole frame is shown in small: its mean light is there
    """

    x: np.ndarray
    y: np.ndarray
    frame: tuple


@dataclass(frozen=True)
class View:
    """What an effect may know of one capture besides its pixels.

    K            3 x 3 intrinsics of the ideal pinhole, pixels; (0, 0) is the centre of the frame's top-left pixel
    width, height  of the frame, pixels
    margin       overscan on each side, pixels: array index = pixel + margin
    T_cam_world  4 x 4 pose that was rendered
    camera, capture, station  names, for seeds
    exposure     scale from radiance to linear image value
    encoding     ``srgb`` or ``linear``
    noise_dn     standard deviation of the noise in each channel, grey levels: the declared one, a number. In the processing
                 of an expected image, which has none of it, what its sensor would add as well, then (H, W, C)
    noise_kernel  in that processing: the kernel (odd, odd), its squares summing to 1, of which that noise is white noise
                 convolved with it; None where it is white
    windows      None where an array is the frame and its margin; else which pixels of the frame it shows, without margin
    """

    K: np.ndarray
    width: int
    height: int
    margin: int
    T_cam_world: np.ndarray
    camera: str
    capture: str
    station: str
    exposure: float = 1.0
    encoding: str = "srgb"
    noise_dn: float | np.ndarray = 0.0
    noise_kernel: np.ndarray | None = None
    windows: Windows | None = None


def light_factor(light, x, y):
    """Return by what the light on the ground at x, y (metres, any shape) exceeds the even one, 0 to 4.

    1 + t + lamp_share (E(x, y) / E(0, 1) - 1): a tilt t = gradient_x x + gradient_y (y - 1), gradients in 1/m, that levels
    off with the distance d from (0, 1) along it, t / sqrt(1 + levelling_per_m2 d^2); and a share of the light that comes
    from a lamp at (lamp_x_m, lamp_y_m, lamp_height_m) whose irradiance E falls as h / d^3 (Lambert's cosine and inverse
    square laws).
    """

    def irradiance(x, y):
        h = light["lamp_height_m"]
        squared = h * h + (x - light["lamp_x_m"]) ** 2 + (y - light["lamp_y_m"]) ** 2
        return h / (squared * np.sqrt(squared))

    tilt = light["gradient_x"] * x + light["gradient_y"] * (y - 1.0)
    bend = levelling(light)
    if bend:
        tilt = tilt / np.sqrt(1 + bend * tilt * tilt)
    return np.clip(1 + tilt + light["lamp_share"] * (irradiance(x, y) / irradiance(0.0, 1.0) - 1), 0, 4)


def levelling(light):
    """Return how a light's tilt t levels off: the factor of t^2 in t / sqrt(1 + factor t^2); 0 where it does not."""
    steepness = light["gradient_x"] ** 2 + light["gradient_y"] ** 2
    return light["levelling_per_m2"] / steepness if steepness else 0.0


def highlight_radiance(highlight, view, x, y):
    """Return the radiance that a glossy lamp adds to a plate at ground points x, y (metres, any shape).

    Blinn-Phong about the plate's normal (Blinn 1977): strength * max(n.h, 0)^(2 / roughness^2), h halfway between
    the directions to the lamp (x_m, y_m, height_m) and to the camera e; n is the world's z. With a share ``fresnel`` of
    Schlick's rise towards grazing light (1994), over glass's reflectance 0.04: times 1 + fresnel (0.96 / 0.04) (1 - h.e)^5.
    """
    R, t = view.T_cam_world[:3, :3], view.T_cam_world[:3, 3]
    half_x, half_y, half_z = 0.0, 0.0, 0.0
    for px, py, pz in (-R.T @ t, (highlight["x_m"], highlight["y_m"], highlight["height_m"])):
        dx, dy = px - x, py - y
        distance = np.sqrt(dx * dx + dy * dy + pz * pz)
        half_x, half_y, half_z = half_x + dx / distance, half_y + dy / distance, half_z + pz / distance
    length = np.sqrt(half_x * half_x + half_y * half_y + half_z * half_z)
    lobe = np.maximum(half_z / length, 0) ** (2 / highlight["roughness"] ** 2)
    grazing = 1 + highlight["fresnel"] * FRESNEL_RISE * (1 - length / 2) ** 5
    return highlight["strength"] * lobe * grazing


def inverse_depth(x, y, view):
    """Return 1 / depth, 1/m, of the ground plane z = 0 along the optical axis at pixels x, y; 0 above the horizon.

    A plane's inverse depth is linear in pixels: normal . (x, y, 1) = (normal . t) / z.
    """
    R, t = view.T_cam_world[:3, :3], view.T_cam_world[:3, 3]
    normal = (R[:, 2] / (R[:, 2] @ t)).astype(np.float32)
    slope = normal[0] * (x - view.K[0, 2]) / view.K[0, 0] + normal[1] * (y - view.K[1, 2]) / view.K[1, 1] + normal[2]
    return np.maximum(slope, 0)


def to_rays(xy, view):
    """Return normalised image coordinates (n, 2), x/z and y/z, of pixels (n, 2)."""
    return (xy - view.K[:2, 2]) / (view.K[0, 0], view.K[1, 1])


def to_pixels(rays, view):
    """Return pixels (n, 2) of normalised image coordinates (n, 2)."""
    return rays * (view.K[0, 0], view.K[1, 1]) + view.K[:2, 2]
