"""Mesh and camera to picture: a numpy z-buffer, shading, blending over a frame."""

from imocap_core.render.draw import draw_mesh
from imocap_core.render.painter import paint_mesh
from imocap_core.render.rasterize import Fragments, rasterize
from imocap_core.render.shading import Light, vertex_normals

__all__ = ["Fragments", "Light", "draw_mesh", "paint_mesh", "rasterize", "vertex_normals"]
