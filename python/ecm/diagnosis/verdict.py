"""The verdict and its report (interfaces.md, Report of diagnose)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Literal

from ecm.diagnosis.accept import AcceptanceCheck
from ecm.models.joint_fit import FittedEffect

Verdict = Literal["none", "named", "ambiguous", "unknown"]


@dataclass(frozen=True)
class Diagnosis:
    """What is missing, what it rests on, and what cannot be said."""

    verdict: Verdict
    answer: tuple[tuple[str, ...], ...]
    """One tuple per missing effect: one id when named, the class when ambiguous."""
    effects: tuple[FittedEffect, ...]
    """The accepted effects, fitted jointly; of a class its best member."""
    base: dict[str, Any]
    noise: dict[str, Any]
    """Figures and source; `tested` effects of the noise, and `effects`, those that are seen."""
    gate: dict[str, float]
    ranking: tuple[dict[str, Any], ...]
    checks: tuple[AcceptanceCheck, ...]
    confusable: tuple[tuple[str, ...], ...]
    not_testable: tuple[dict[str, str], ...]
    detection_limits: dict[str, dict[str, Any]]
    unknown: dict[str, Any] | None
    rmse: dict[str, dict[str, float]]
    held_out: dict[str, Any]
    signature: dict[str, float]
    next_experiment: tuple[dict[str, Any], ...]
    outliers: tuple[int, ...]
    """Rows of the table whose robust weight is below one half, from 0; in the report from 1."""
    seed: int
    upper_bound: float
    """95 % bound on the strength of what smooth functions could still hide."""
    warnings: tuple[str, ...] = field(default=())
    further: tuple[dict[str, Any], ...] = ()
    """Richer forms of the named effects that were tried, and whether held-out rows keep them."""
    left: dict[str, float] = field(default_factory=dict)
    """What stays after the accepted effects: chi2 beyond chance, its dof, share, p."""

    def sentence(self) -> str:
        """One plain sentence."""
        after = self._fall()
        said = {
            "repeats": "",
            "declared": " The noise is as declared, not measured.",
            "assumed": " The noise is assumed: give repeats or [instrument] figures.",
        }[self.noise["source"]]
        if self.verdict == "none":
            bounded = math.isfinite(self.upper_bound)
            bound = f"s < {self.upper_bound:.2f}" if bounded else "too few rows to bound s"
            text = f"Nothing is missing that these data could show ({bound})."
        elif self.verdict == "unknown":
            nearest = self.unknown["nearest"] if self.unknown else None
            near = f"; nearest is {nearest['id']} ({nearest['share']:.0%})" if nearest else ""
            words = self.unknown["words"] if self.unknown else ""
            listed = ", ".join(" or ".join(members) for members in self.answer_so_far())
            already = f" beside {listed}" if listed else ""
            text = f"Something is missing{already} that no known effect explains: {words}{near}."
        else:
            text = " and ".join(" or ".join(members) for members in self.answer)
            text = f"Missing: {text}; {after}."
        return text + said

    def _fall(self) -> str:
        before, after = self.held_out["before"], self.held_out["after"]
        return f"held-out error {before:.2f} -> {after:.2f} times the noise"

    def answer_so_far(self) -> tuple[tuple[str, ...], ...]:
        """Accepted effects, also where the verdict is `unknown`."""
        return tuple((item.id,) for item in self.effects)

    def to_dict(self) -> dict[str, Any]:
        """The report; rows are counted from 1, as `worst_rows` of `compare` are."""
        return {
            "schema": 1,
            "seed": self.seed,
            "sentence": self.sentence(),
            "base": self.base,
            "noise": self.noise,
            "gate": self.gate,
            "verdict": self.verdict,
            "effects": [
                {
                    "id": item.id,
                    "shape": item.effect.shape,
                    "parameters": {
                        parameter.name: {
                            "value": float(value),
                            "sd": float(sd),
                            "unit": parameter.unit,
                        }
                        for parameter, value, sd in zip(
                            item.effect.parameters, item.values, item.sd, strict=True
                        )
                    },
                }
                for item in self.effects
            ],
            "answer": [list(members) for members in self.answer],
            "ranking": list(self.ranking),
            "checks": [
                {
                    "id": found.id,
                    "p_holm": found.p_holm,
                    "delta_bic": found.delta_bic,
                    "held_out_fall": found.held_out_fall,
                    "chosen_share": found.chosen_share,
                    "robust": found.robust,
                    "within_bounds": found.within_bounds,
                    "own_seen": found.own_seen,
                    "accepted": found.accepted,
                }
                for found in self.checks
            ],
            "confusable": [list(pair) for pair in self.confusable],
            "not_testable": list(self.not_testable),
            "detection_limits": self.detection_limits,
            "unknown": self.unknown,
            "rmse": self.rmse,
            "held_out": self.held_out,
            "signature": self.signature,
            "next_experiment": list(self.next_experiment),
            "outliers": [row + 1 for row in self.outliers],
            "upper_bound": self.upper_bound,
            "left_over": self.left,
            "further": list(self.further),
            "warnings": list(self.warnings),
        }
