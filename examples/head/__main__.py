"""A head on its neck misses, the missing effect is found, and the head hits.

    python examples/head --out out/head

docs/head.md explains the robot; README.md says which file to read first.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import ecm

try:
    import mujoco

    from experiment import Robot
    from film import write_film
    from loop import run_loop
    from neck import HIDDEN, fem_neck
    from robot import HeadSettings
except ModuleNotFoundError as error:
    sys.exit(f"error: {ecm.MissingExtra(str(error.name), 'robot', 'The head')}")


def main() -> None:
    """Run the command."""
    description = (__doc__ or "").split("\n", maxsplit=1)[0]
    parser = argparse.ArgumentParser(prog="python examples/head", description=description)
    parser.add_argument("--out", type=Path, required=True, help="folder to write into")
    parser.add_argument(
        "--hide",
        default="temperature_modulus",
        choices=HIDDEN,
        help="in the neck: %(choices)s (%(default)s)",
        metavar="EFFECT",
    )
    parser.add_argument("--poses", type=int, default=50, help="poses of the campaign (%(default)s)")
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of the random generator (%(default)s)"
    )
    parser.add_argument("--film", type=Path, metavar="FILE.gif", help="film of both, side by side")
    given = parser.parse_args()
    try:
        run(given.out, given.hide, given.poses, given.seed, given.film)
    except ecm.EcmError as error:
        sys.exit(f"error: {error}")
    except mujoco.FatalError as error:
        sys.exit(
            f"error: {error}\nWithout a screen, set MUJOCO_GL=egl (or osmesa) in the environment."
        )


def run(out: Path, hide: str, poses: int, seed: int, film: Path | None) -> None:
    """Carry out the loop and write campaign, models, figures and film."""
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
        film.parent.mkdir(parents=True, exist_ok=True)
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
