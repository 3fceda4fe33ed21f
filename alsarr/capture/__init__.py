"""Rendered data: what a viewpoint shows at every shading rate, and what was known."""

from ._animation import (
    Animation as Animation,
    camera_path as camera_path,
    CameraPath as CameraPath,
)
from ._camera import Camera as Camera
from ._capture import capture_view as capture_view
from ._coarse import (
    coarse_invocations as coarse_invocations,
    Invocations as Invocations,
)
from ._hall import hall as hall
from ._load import load_scene as load_scene
from ._render import render as render
from ._scene import (
    Lights as Lights,
    Material as Material,
    Materials as Materials,
    Mesh as Mesh,
    Scene as Scene,
)
from ._texels import linear_light as linear_light, Texels as Texels
from ._tracer import Tracer as Tracer
from ._view import (
    CHANNELS as CHANNELS,
    load_view as load_view,
    save_view as save_view,
    View as View,
    views as views,
)
from ._viewpoints import (
    FAST as FAST,
    Movement as Movement,
    SLOW as SLOW,
    ViewpointSampler as ViewpointSampler,
)
