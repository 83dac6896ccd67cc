"""Photos to one texture per part.

In: equally bright photos of both states, `model.twin.Part`s. Out: a `model.twin.Texture` of each.
Call: `bake.bake`.
"""
