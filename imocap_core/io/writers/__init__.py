"""Writers of exports, one file a format.

`motion_clip` and `clip_body` are the values that are written: a joint tree with its motion, and its
surface and camera. `bvh`, `gltf_scene` (in a `glb` container), `trc`, `joints_csv` and `export_npz`
write them; `foxglove` makes the messages of a view file, `mcap_view` writes them.
"""
