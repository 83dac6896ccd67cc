"""Variants of the ablation: which terms are on in each, and which pairs of variants are compared.

All variants of one object and seed share the fits of both states and the motions that were decided
on, so that a difference between two of them is the difference of their terms.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from part2gs_robotics.config import ArticulateConfig

# In the order of the paper's ablation; its physics is the last three together. The articulation
# loss comes before repel points, which as printed act through other terms only.
ORDER = ("identity", "articulation", "repel", "vector_field", "velocity", "contact")
SWITCHES = (*ORDER, "alignment")
NAMES = {
    "vanilla": "vanilla", "identity": "+ parts", "canonical": "parts, centres averaged",
    "articulation": "+ articulation loss",
    "repel": "+ repel points", "vector_field": "+ vector field", "velocity": "+ velocity",
    "contact": "+ contact", "alignment": "parts, alignment", "ours": "ours (defaults)",
}  # fmt: skip
PRINTED = "_printed"
AVERAGED = "canonical" + PRINTED  # eq. 3: surfaces of averaged centres, else as + parts


@dataclass(frozen=True)
class Comparison:
    """Two variants that differ in one thing.

    Attributes:
        key: term, or group of terms.
        form: "corrected", "printed", or "printed for corrected".
        before: variant without it.  after: variant with it.
    """

    key: str
    form: str
    before: str
    after: str


def variants(seed: int) -> dict[str, ArticulateConfig]:
    """Return the settings of every variant by name, in the order of the table."""
    off = replace(ArticulateConfig(seed=seed), **dict.fromkeys(SWITCHES, False))
    chain = {name: replace(off, **dict.fromkeys(ORDER[: k + 1], True))
             for k, name in enumerate(ORDER)}
    printed = {name + PRINTED: replace(config, paper_mode=True) for name, config in chain.items()}
    aligned = replace(off, identity=True, alignment=True)
    return {"vanilla": off, **chain, "alignment": aligned, "ours": ArticulateConfig(seed=seed),
            **printed, AVERAGED: chain["identity"]}


def comparisons() -> list[Comparison]:
    """Return what is compared, fixed before any result is seen."""
    found = []
    for form, suffix in (("corrected", ""), ("printed", PRINTED)):
        chain = ["vanilla", *(name + suffix for name in ORDER)]
        found += [Comparison(name, form, before, after)
                  for name, before, after in zip(ORDER, chain[:-1], chain[1:], strict=True)]
        found.append(Comparison("physics", form, "repel" + suffix, "contact" + suffix))
    found.append(Comparison("alignment", "corrected", "identity", "alignment"))
    found.append(Comparison("pull before alignment", "corrected", "alignment", "ours"))
    return found + [Comparison(name, "printed for corrected", name, name + PRINTED)
                    for name in ORDER] + [
        Comparison("canonical", "printed for corrected", "identity", AVERAGED)]
