"""Pictures of equilibria: polylines, then frames (needs Pillow, the extra ``render``)."""

try:
    import PIL  # noqa: F401 (whether it is there)
except ModuleNotFoundError as error:
    raise ImportError("pictures need Pillow, which is not installed: pip install 'pcm_gym[render]'") from error

from pcm_gym.rendering.batches import tile_frames
from pcm_gym.rendering.camera import Camera
from pcm_gym.rendering.frame import FrameRenderer
from pcm_gym.rendering.polylines import Polylines, equilibrium_polylines
from pcm_gym.rendering.style import Style
from pcm_gym.rendering.vector import equilibrium_svg

__all__ = [
    "Camera",
    "FrameRenderer",
    "Polylines",
    "Style",
    "equilibrium_polylines",
    "equilibrium_svg",
    "tile_frames",
]
