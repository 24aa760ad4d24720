"""A head on its neck misses, the missing effect is found, and the head hits.

    python examples/head --out out/head --film out/head/film.gif

docs/head.md explains the robot; README.md says which file to read first.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

import ecm


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(
        prog="examples/head", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to write into")
    parser.add_argument(
        "--hide", default="temperature_modulus", metavar="EFFECT",
        choices=["temperature_modulus", "stress_relaxation", "hysteresis"],
        help="in the neck: temperature_modulus (default), stress_relaxation or hysteresis",
    )  # fmt: skip
    parser.add_argument("--poses", type=int, default=50, help="poses of the campaign (50)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random generator (0)")
    parser.add_argument("--film", type=Path, metavar="FILE.gif", help="film of both, side by side")
    given = parser.parse_args()
    if given.film is not None:
        given.film.parent.mkdir(parents=True, exist_ok=True)
        if (
            sys.platform == "linux"
        ):  # MuJoCo asks for it when it is loaded; it draws without a screen
            os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        run(given.out, given.hide, given.poses, given.seed, given.film)
    except ecm.EcmError as error:
        sys.exit(f"error: {error}")
    except ModuleNotFoundError as error:
        sys.exit(f"error: {error}; the head needs MuJoCo: pip install 'ecm-stiffness[robot]'")


def run(out: Path, hide: str, poses: int, seed: int, film: Path | None) -> None:
    """Carry out the loop and write campaign, models, figures and film."""
    from experiment import Robot  # noqa: PLC0415 - it loads MuJoCo
    from film import write_film  # noqa: PLC0415
    from loop import run_loop  # noqa: PLC0415
    from neck import HIDDEN, fem_neck  # noqa: PLC0415
    from robot import HeadSettings  # noqa: PLC0415

    out.mkdir(parents=True, exist_ok=True)
    say("the true neck: FEM of 420 poses, once")
    neck = fem_neck(out / "neck.json", (HIDDEN[hide],))
    loop = run_loop(neck, out / "code", seed=seed, poses=poses, say=say)
    loop.table.write(out / "campaign.csv")
    loop.before.save(out / "before.json")
    loop.after.save(out / "after.json")
    figures = {"seed": seed, "hidden": hide, **loop.to_dict()}
    (out / "head.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    print("\n".join(loop.lines()))
    if film is not None:
        say("filming")
        robot = Robot.with_model(HeadSettings(), neck, loop.after, out / "code")
        frames = write_film(film, robot, [("before", loop.missed), ("after", loop.hit)])
        print(f"{film}: {frames} frames")
    print(f"{out}: campaign.csv, before.json, after.json, head.json")
    print(f"next: ecm compare {out}/after.json {out}/campaign.csv")


def say(text: str) -> None:
    """Tell what is being done."""
    print(text, file=sys.stderr)


if __name__ == "__main__":
    main()
