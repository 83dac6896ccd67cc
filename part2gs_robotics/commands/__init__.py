"""What stands around a build: the scene made of plain photos, many scenes, the machine's health.

In: paths and settings of one command. Out: files or text; no room of the corridor is entered here.
Call: `from_photos.scene_of_photos`, `batch.run_batch`, `doctor.examine`, `completion.script`.
"""
