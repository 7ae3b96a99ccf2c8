"""`tssgeom live`: its options here; the stream in `run` and `session`, the processes beside it in `worker`.

What it needs is imported when it runs, so that `--help` is quick.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipelines.options import Map, PolicyChoice, RigFile, TensionIn, ToleranceMm, Unit


def live(
    source: Annotated[
        list[str] | None,
        typer.Option(
            "--source", help="-, tcp://127.0.0.1:PORT, udp://…, igtl://HOST:18944, replay:FILE[?speed=2]."
        ),
    ] = None,
    sink: Annotated[
        list[str] | None,
        typer.Option("--sink", help="-, tcp://127.0.0.1:PORT, udp://…, igtl://127.0.0.1:PORT, none."),
    ] = None,
    rig: RigFile = None,
    tension_in: TensionIn = None,
    unit: Unit = None,
    columns: Map = None,
    tolerance_mm: ToleranceMm = None,
    policy: PolicyChoice = "cross",
    adapt: Annotated[
        bool, typer.Option("--adapt", help="Follow friction, zeros, or what the rig names in adapt.")
    ] = False,
    write_rig: Annotated[
        Path | None,
        typer.Option("--write-rig", help="With --adapt: rig file to write each minute and at the end."),
    ] = None,
    stale_after: Annotated[
        float,
        typer.Option("--stale-after", min=0.001, help="Silence after which a stale line is sent, in s."),
    ] = 0.2,
    deadline_ms: Annotated[
        float | None,
        typer.Option(
            "--deadline-ms",
            min=1.0,
            help="Time in which an answer is out, else a late line is, in ms; 3 frames by default.",
        ),
    ] = None,
    spin: Annotated[
        bool, typer.Option(help="Above 90 frames a second, await the next without sleep: that takes a core.")
    ] = True,
    stats: Annotated[
        bool, typer.Option("--stats", help="Print statistics each second as JSON on stderr.")
    ] = False,
    state: Annotated[
        Path | None, typer.Option("--state", help="File that keeps the tendon's state for the next start.")
    ] = None,
    record: Annotated[Path | None, typer.Option("--record", help="Rerun recording (.rrd) to write.")] = None,
    record_rotate: Annotated[
        str | None,
        typer.Option("--record-rotate", help="Size or age that ends a recording: 500MB, 2GiB, 30min, 1h."),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Host the picture for Rerun viewers.")] = False,
    view_port: Annotated[int, typer.Option("--view-port", min=1, max=65535, help="Port for viewers.")] = 9876,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Let sockets use other addresses than loopback.")
    ] = False,
    token_file: Annotated[
        Path | None, typer.Option("--token-file", help="File with the token that clients have to send first.")
    ] = None,
) -> None:
    """Answer each shape as it is sensed with tension, elongation and the command that reaches its target.

    --source and --sink may be given more than once; both are - (standard input and output) by default.
    """
    from pipelines.inputs import run_settings
    from pipelines.live.kept_files import rotation_of
    from pipelines.live.run import LiveOptions, run
    from tssgeom.io.network.addresses import access, each_once, sink_of, source_of

    options = LiveOptions(
        sources=[source_of(one) for one in each_once(source or ["-"], "--source")],
        sinks=[sink_of(one) for one in each_once(sink or ["-"], "--sink")],
        access=access(allow_remote=allow_remote, token_file=token_file),
        stale_after=stale_after,
        deadline=None if deadline_ms is None else 1e-3 * deadline_ms,
        spin=spin,
        stats=stats,
        state=state,
        record=record,
        rotation=None if record_rotate is None else rotation_of(record_rotate),
        view_port=view_port if view else None,
        tolerance=None if tolerance_mm is None else 1e-3 * tolerance_mm,
        policy=policy,
        adapt=adapt,
        write_rig=write_rig,
    )
    settings = run_settings(rig, tension_in, unit, columns=columns, takes_machines=True)
    raise typer.Exit(run(options, settings))
