"""Plain photos or videos of two states to a scene folder that `build` reads.

In: two folders of photos (or videos), nothing else. Out: a scene folder with cameras, masks and
scale. Call: `make_scene.make_scene`.
"""
