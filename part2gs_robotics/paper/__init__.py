"""Terms of the Part2GS paper, as printed and as corrected.

In: surfels or Gaussians of parts, joints. Out: identities (eq. 4), pulls on joints (eqs. 5-9).
Call: `identity.refine_identities`, `pull.physical_steps`.
"""
