"""Gaussians to images, and gradients of a loss back to the Gaussians.

In: `Splats` and a `Camera`. Out: `Rendered`, then `Gradients`.
Call: `dispatch.render` and `dispatch.render_backward`, on the device that `pick_device` chose.
"""
