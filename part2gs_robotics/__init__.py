"""Two-state photos of an articulated object in, MuJoCo-checked digital twin out."""

__version__ = "0.1.0"
