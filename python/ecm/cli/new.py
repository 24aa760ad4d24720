"""`ecm new`: a file to begin from."""

from __future__ import annotations

from pathlib import Path

from ecm.cli.options.new import Options, What
from ecm.cli.session import Session
from ecm.errors import InputError
from ecm.io.cache import write_atomically
from ecm.io.interrupts import uninterrupted
from ecm.io.templates import NEXT_STEP, data_template, description_template, template

_FILES = {"config": "config.toml", "rig": "rig.toml", "data": "data.csv"}


def new(options: Options, session: Session) -> None:
    """Run `ecm new`."""
    usual = _FILES[options.what.value]
    path = options.out or Path(usual)
    dof = int(options.dof.value)
    is_data = options.what is What.data
    files = {path: data_template(dof) if is_data else template(usual)}
    if is_data:
        if path.suffix == ".toml":
            raise InputError(f"{path}: expected the name of the table, e.g. {path.stem}.csv")
        files[path.with_suffix(".toml")] = description_template(dof)
    session.check_output(*files)
    there = [target for target in files if target.exists()]
    # A kill between the two files of a pair leaves one as it was written: the other is added.
    half = len(there) < len(files) and all(t.read_bytes() == files[t].encode() for t in there)
    if there and not half:
        raise InputError(
            f"{there[0]} is already there and is not overwritten. Choose another name with "
            "--out FILE."
        )
    with uninterrupted():
        for target, text in files.items():
            write_atomically(target, text)
    for target in files:
        session.print(f"wrote {target}")
    session.write_json({"schema": 1, "files": [str(target) for target in files]})
    session.print(NEXT_STEP[options.what.value].format(path=path))
