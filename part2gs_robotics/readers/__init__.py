"""Folders of photos to a `Scene`.

In: a scene folder in any known layout. Out: `model.scene.Scene`, checked, or a `SceneError`.
Call: `read_scene.read_scene`.
"""
