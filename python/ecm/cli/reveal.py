"""`ecm reveal`: the sealed truth of a simulated campaign."""

from __future__ import annotations

from ecm.cli.options.reveal import Options
from ecm.cli.session import Session
from ecm.rig import reveal as reveal_truth


def reveal(options: Options, session: Session) -> None:
    """Run `ecm reveal`."""
    revealed = reveal_truth(options.data, options.answer)
    session.write_json(revealed.to_dict())
    session.print(revealed.text())
