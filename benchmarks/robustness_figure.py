"""Figure of the robustness rows: one column per thing that is varied."""

from __future__ import annotations

from pathlib import Path
from typing import Any

CLEAN = ("views", 64.0)  # the row every other one differs from in one thing
PLACE = {"pose noise, deg": 0.0, "pixels": 400.0, "seed": 0.0, "exposure of state 1": 1.0,
         "shadows that move": 0.0}  # where the clean scene lies on each axis
METRICS = (("angle_deg", "axis error, deg"), ("miou", "segmentation mIoU"))


def draw(rows: list[dict[str, Any]], path: Path) -> None:
    """Write the figure: rows of one kind over their value, one line per object."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    kinds = list(dict.fromkeys(row["row"] for row in rows))
    figure, axes = plt.subplots(2, len(kinds), figsize=(2.6 * len(kinds), 5), squeeze=False)
    for column, kind in enumerate(kinds):
        for line, (metric, label) in enumerate(METRICS):
            ax = axes[line][column]
            for name in dict.fromkeys(row["object"] for row in rows):
                points = curve(rows, kind, name, metric)
                ax.plot([x for x, _ in points], [y for _, y in points], "o-", label=name)
            ax.set_ylim(bottom=0)
            ax.set_xlabel(kind)
            if column == 0:
                ax.set_ylabel(label)
    axes[0][0].legend(fontsize="small")
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    plt.close(figure)


def curve(rows: list[dict[str, Any]], kind: str, name: str,
          metric: str) -> list[tuple[float, float]]:
    """Return (value, metric) of one object in rising order, the clean scene among them."""
    found = {}
    for row in rows:
        clean = (row["row"], float(row["value"])) == CLEAN and kind in PLACE
        if row["object"] == name and (row["row"] == kind or clean) and row[metric] is not None:
            found[PLACE[kind] if row["row"] != kind else float(row["value"])] = row[metric]
    return sorted(found.items())
