"""`ecm simulate`: wrenches to poses by FEM."""

from __future__ import annotations

import shutil
from dataclasses import replace

from ecm.cli.options.simulate import Options
from ecm.cli.outputs import check_not_read, check_output_directory
from ecm.cli.session import Session
from ecm.fem.simulate import simulate as simulate_pairs
from ecm.fem.simulate import write_vtu
from ecm.workflow.config import read_config

_VTU = 10
"""Poses that --vtu draws."""


def simulate(options: Options, session: Session) -> None:
    """Run `ecm simulate`."""
    out = options.out
    check_not_read(out, options.config)
    session.check_output(out)
    if options.vtu is not None:
        check_output_directory(options.vtu)
    config = read_config(options.config)
    parts = out.with_suffix(".parts")
    session.on_interrupt(f"finished cases are kept in {parts}. The same command goes on there.")
    workspace = config.workspace
    pairs = simulate_pairs(
        config.mechanism,
        config.simulate.n,
        replace(workspace, full_box=options.full_box or workspace.full_box),
        seed=session.seed,
        threads=session.threads,
        directory=parts,
        scheduler=options.scheduler,
        progress=session.progress("FEM poses"),
    )
    pairs.table(str(out)).write(out)
    session.on_interrupt(f"complete: {out}. Run the same command again for the rest.")
    if options.vtu is not None:
        shown = pairs.wrenches[:_VTU]
        write_vtu(config.mechanism, shown, options.vtu)
        session.print(f"{options.vtu}: {len(shown)} deformed bodies with displacement and stress")
    shutil.rmtree(parts, ignore_errors=True)
    newton = {"kept": float(pairs.iterations.mean()), "all": pairs.newton_per_case}
    session.write_json(
        {
            "schema": 1,
            "seed": session.seed,
            "counts": pairs.counts,
            "newton_per_case": newton,
            "data": str(out),
        }
    )
    session.print(", ".join(f"{name} {count}" for name, count in pairs.counts.items()))
    session.print(
        f"Newton iterations a case: {newton['kept']:.2f} of kept, {newton['all']:.2f} of all"
    )
    session.print(f"{out}: {len(pairs)} wrench-pose pairs")
