"""Photos of one state to its Gaussians.

In: `StateViews`. Out: `fit_state.FitResult`: Gaussians and the held-out PSNR over time.
Call: `fit_state.fit_state`, once for each state.
"""
