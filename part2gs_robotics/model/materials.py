"""Named densities: photos show no mass, so a twin's is its volume times one of these."""

from __future__ import annotations

DEFAULT = "furniture"
MATERIALS = {  # kg/m3
    "furniture": 600.0,  # between particle board (650) and plastic housings with air inside
    # EN 1991-1-1:2002, annex A: nominal kN/m3, here x 100 kg/m3
    "softwood": 420.0,  # C24
    "hardwood": 640.0,  # D30
    "plywood": 700.0,  # of birch
    "chipboard": 750.0,  # 7 to 8
    "mdf": 800.0,
    "acrylic": 1200.0,
    "glass": 2500.0,
    "aluminium": 2700.0,
    "steel": 7850.0,
    "ceramic": 2400.0,  # porcelain of tableware, 2300 to 2500
    "plastic": 1050.0,  # ABS, ISO 1183 data sheets: 1030 to 1070
}
LIGHTEST, HEAVIEST = 1.0, 25_000.0  # kg/m3 that can mean anything: aerogel, and above osmium


def density_of(material: str) -> float | None:
    """Return kg/m3 of a name in MATERIALS or of a number as text; None if it is neither."""
    if material in MATERIALS:
        return MATERIALS[material]
    try:
        number = float(material)
    except ValueError:
        return None
    return number if LIGHTEST <= number <= HEAVIEST else None
