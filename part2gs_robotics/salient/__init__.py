"""Masks by a network of the user's own; none is shipped and none is fetched.

In: an ONNX file and photos. Out: masks. Call: `network.load_network`, then `Network.mask`.
"""
