"""Ahead: on a machine's first build all cores compile kernels, before the rooms ask for them.

In: `kernels.txt`. Out: compiled kernels where `runtime.jit_cache` says. Call: `compile_ahead`.
"""
