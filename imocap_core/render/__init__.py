"""Mesh rendering: a numpy z-buffer and a painter's algorithm, shading, blending over a frame."""

from imocap_core.render.draw import draw_mesh
from imocap_core.render.painter import paint_mesh
from imocap_core.render.rasterize import Fragments, rasterize
from imocap_core.render.shading import Light, vertex_normals

__all__ = ["Fragments", "Light", "draw_mesh", "paint_mesh", "rasterize", "vertex_normals"]
