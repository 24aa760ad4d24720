"""`ecm head`: a head on the neck misses, the missing effect is found, and the head hits."""

from __future__ import annotations

from ecm.cli.options.head import Options
from ecm.cli.outputs import check_output_directory
from ecm.cli.session import Session
from ecm.io.cache import cache_directory
from ecm.io.extras import require
from ecm.io.mechanism import Mechanism
from ecm.workflow.head.film import write_film
from ecm.workflow.head.loop import hidden_effect, run_loop
from ecm.workflow.head.neck_wrench import fem_neck
from ecm.workflow.head.settings import HeadSettings
from ecm.workflow.head.table import Bench


def head(options: Options, session: Session) -> None:
    """Run `ecm head`."""
    require("mujoco", "robot", "ecm head")
    check_output_directory(options.out)
    session.check_output(options.film)
    effect = hidden_effect(options.hide)
    settings, mechanism = HeadSettings(), Mechanism()
    with session.working("solving the true neck by FEM"):
        neck = fem_neck(mechanism, (effect,), folder=cache_directory())
    bench = Bench(neck, settings, mechanism, options.out / "code")
    loop = run_loop(bench, seed=session.seed, poses=options.poses, say=session.note)
    loop.table.write(options.out / "campaign.csv")
    loop.before.save(options.out / "before.json")
    loop.after.save(options.out / "after.json")
    for line in loop.lines():
        session.print(line)
    session.write_json(
        {"schema": 1, "seed": session.seed, "hidden": options.hide, **loop.to_dict()}
    )
    if options.film is not None:
        with session.working("filming"):
            records = [("before", loop.missed), ("after", loop.hit)]
            frames = write_film(options.film, settings, neck, records)
        session.print(f"{options.film}: {frames} frames")
    session.print(f"{options.out}: campaign.csv, before.json, after.json")
    session.print(f"next: ecm compare {options.out}/after.json {options.out}/campaign.csv")
