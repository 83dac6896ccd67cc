"""How the program runs: kernels, threads, devices, files. Nothing here knows what a scene is.

In: arrays, bytes, functions. Out: compiled kernels, results of threads, stages on disk, log lines.
Call: `store.Store` keeps stages, `jit.kernel` compiles, `side_by_side.side_by_side` runs tasks.
"""
