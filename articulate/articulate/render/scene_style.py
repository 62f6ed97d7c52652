"""Colours and sky of rendered MuJoCo scenes."""

from __future__ import annotations

from articulate.simulator import mujoco

HORIZON_RGB, ZENITH_RGB = (0.93, 0.945, 0.955), (0.70, 0.78, 0.85)
PART_RGBA = ((0.80, 0.79, 0.76, 1.0), (0.72, 0.53, 0.34, 1.0), (0.55, 0.63, 0.66, 1.0))
"""Colours of an object without colours: root, then the moving links in turn."""

Rgb = tuple[float, float, float]


def add_sky(
    spec: mujoco.MjSpec, width: int, zenith: Rgb = ZENITH_RGB, horizon: Rgb = HORIZON_RGB
) -> None:
    """Add a sky box with a colour gradient.

    Args:
        spec: Scene to change.
        width: Side of the texture [px].
        zenith: Colour overhead, in [0, 1].
        horizon: Colour at the horizon, in [0, 1].
    """
    spec.add_texture(
        name="stage_sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=zenith,
        rgb2=horizon,
        width=width,
        height=6 * width,
    )


def part_rgba(k: int) -> tuple[float, float, float, float]:
    """Return the colour of link ``k`` of an object without colours; 0 is its root."""
    return PART_RGBA[0 if k == 0 else 1 + (k - 1) % (len(PART_RGBA) - 1)]
