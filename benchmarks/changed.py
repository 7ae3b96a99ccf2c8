"""Runs cases with one tuned constant changed: one copy of the code, one process, a fork of it for each run.

The copy differs from the code in two ways. Its core reads the constants from variables, which each process
fills from the containers in Python; no sum is reordered, so every digit stays. And each container notes
which of its fields are read: one that is not read by the cases cannot move them, and one that is read while a
module is imported has to be changed in the source, before a new process imports it.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

_COPIED = ("tssgeom", "pipelines", "benchmarks", "tests", "sample_shapes", "pyproject.toml", "CITATION.cff")
_CONSTANT = '__attribute__((unused)) static const struct {{ {fields} }} {name} = {{ {numbers} }};"'
_VARIABLE = '__attribute__((visibility(\\"default\\"))) struct {{ {fields} }} {name};"'
_FILL = "\nfrom benchmarks.changed import fill_core\nfill_core(Path(__file__).parent)\n"
_NOTE = "\n__import__('benchmarks.changed').changed.note_reads({name})\n"
_SERVE = "from benchmarks.changed import serve; serve()"
_SAME = 1e-6  # relative change that counts as none: a search may end one step away
_PATIENCE = 20.0  # times the processor time of the unchanged code, then a run is stopped
_READS = set[tuple[str, str]]()
Field = tuple[str, str, str]
"""Module, container and field of a constant."""


class MovedError(Exception):
    """A number differs from that of the unchanged code."""


class Numbers:
    """Takes the numbers of the cases one by one, and may stop the run at the first that moves."""

    def __init__(self, before: Sequence[float] | None) -> None:
        self.before, self.taken = before, list[float]()

    def take(self, *values: float) -> None:
        """Take numbers of a case; raises MovedError where one differs from the one before."""
        for value in map(float, values):
            at = len(self.taken)
            self.taken.append(value)
            if self.before is not None and not (at < len(self.before) and _same(self.before[at], value)):
                raise MovedError


def _same(before: float, after: float) -> bool:
    return math.isclose(before, after, rel_tol=_SAME, abs_tol=1e-12) or (
        math.isnan(before) and math.isnan(after)
    )


def note_reads(container: Any) -> None:
    """Make a container note the fields that are read of it."""

    def read(self: object, name: str) -> object:
        if name in container.__annotations__:
            _READS.add((f"{container.__module__}.{container.__name__}", name))
        return object.__getattribute__(self, name)

    container.__getattribute__ = read


def fill_core(folder: Path) -> None:
    """Write the numbers of the containers into the variables of the core."""
    for path in sorted(folder.glob("_core*.so")):
        library = ctypes.CDLL(str(path))
        for module in sorted(each.stem for each in folder.glob("constants*.py")):
            for name, value in vars(importlib.import_module(f"tssgeom.core.{module}")).items():
                if name.isupper():
                    _fill(library, name, value)


def _fill(library: ctypes.CDLL, name: str, value: Any) -> None:
    kinds = [ctypes.c_double if isinstance(one, float) else ctypes.c_int64 for one in value]
    fields = {"_fields_": list(zip(value._fields, kinds, strict=True))}
    structure: Any = type(name, (ctypes.Structure,), fields)
    for field, one in zip(value._fields, value, strict=True):
        setattr(structure.in_dll(library, name), field, one)


class Copy:
    """A copy of the code, and the process in it that runs cases."""

    def __init__(self, root: Path, folder: Path, containers: Mapping[str, Sequence[tuple[str, int]]]) -> None:
        """Copy the code; `containers` has the name and last line of each, by file."""
        self.folder, self.process = folder, None
        for name in _COPIED:
            (shutil.copytree if (root / name).is_dir() else shutil.copy2)(root / name, folder / name)
        for file, each in containers.items():
            _insert(folder / file, [(line, _NOTE.format(name=name)) for name, line in each])
        core = folder / "tssgeom" / "core"
        if (core / "build.py").exists():
            _make_variable(core)
        self._start()

    def _start(self) -> None:
        environment = {**os.environ, "PYTHONPATH": str(self.folder)}
        command, pipe = [sys.executable, "-c", _SERVE], subprocess.PIPE
        self.process = subprocess.Popen(
            command, cwd=self.folder, env=environment, stdin=pipe, stdout=pipe, text=True
        )

    def run(self, area: str, *, quick: bool, field: Field | None = None, **more: object) -> dict[str, Any]:
        """Run the cases of an area; `more` is the new value, and the numbers before, as `_run` takes them."""
        process = self.process
        assert process is not None
        assert process.stdin
        assert process.stdout
        request = {"area": area, "quick": quick, "field": field, **more}
        process.stdin.write(json.dumps(request) + "\n")
        process.stdin.flush()
        return json.loads(process.stdout.readline() or '{"failed": "the process ended"}')

    def restart(self) -> None:
        """Import the code anew, after its source was changed."""
        self.close()
        self._start()

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.communicate()  # an end of its requests ends it


def _insert(path: Path, after: Sequence[tuple[int, str]]) -> None:
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    for line, text in after:
        lines[line - 1] += text
    path.write_text("".join(lines), encoding="utf-8")


def _make_variable(core: Path) -> None:
    """Build the core of a copy with variables for constants."""
    build = core / "build.py"
    code = build.read_text(encoding="utf-8")
    for old, new in ((_CONSTANT, _VARIABLE), ('"-shared"', '"-shared", "-fcommon"')):
        if code.count(old) != 1:
            raise RuntimeError(f"tssgeom/core/build.py has no {old}")
        code = code.replace(old, new)
    build.write_text(code, encoding="utf-8")
    made = "import runpy, sys; from pathlib import Path; "
    made += "runpy.run_path('tssgeom/core/build.py')['build'](Path('tssgeom/core'))"
    subprocess.run([sys.executable, "-c", made], cwd=core.parents[1], check=True, capture_output=True)
    build.unlink()  # nothing is built again when a source changes
    with (core / "binding.py").open("a", encoding="utf-8") as file:
        file.write(_FILL)


def edit(path: Path, span: tuple[int, int, int, int], new: str) -> None:
    """Write a text over the span of a source: line and column in bytes of its begin, and of its end."""
    line, column, end_line, end_column = span
    lines = path.read_bytes().splitlines(keepends=True)
    head, tail = lines[line - 1][:column], lines[end_line - 1][end_column:]
    lines[line - 1 : end_line] = [head + new.encode() + tail]
    path.write_bytes(b"".join(lines))
    forget(path)


def forget(path: Path) -> None:
    """Remove what Python has compiled of a module, since it compares size and whole seconds only."""
    for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
        compiled.unlink()


def serve() -> None:
    """Answer requests for runs, one line of JSON each, until there are no more; each runs in a fork."""
    answers, sys.stdout = sys.stdout, sys.stderr
    from benchmarks import sensitivity_cases  # of the copy

    sensitivity_cases.prepare()
    seconds = dict[str, float]()
    for line in sys.stdin:
        request = json.loads(line)
        source, sink = os.pipe()
        if not (child := os.fork()):
            signal.alarm(max(60, math.ceil(_PATIENCE * seconds.get(request["area"], 60.0))))
            os.write(sink, json.dumps(_run(sensitivity_cases, request)).encode())
            os._exit(0)
        os.close(sink)
        with os.fdopen(source, "rb") as file:
            text = file.read()
        _, status = os.waitpid(child, 0)
        answer: dict[str, Any] = json.loads(text) if text else {"failed": f"no result, status {status}"}
        if request["field"] is None:
            seconds[request["area"]] = float(answer.get("seconds", 60.0))
            for name in answer.pop("modules", ()):
                importlib.import_module(name)  # once for all forks
        print(json.dumps(answer | {"imported": sorted(_READS)}), file=answers, flush=True)


def _run(cases: Any, request: Mapping[str, Any]) -> dict[str, Any]:
    _READS.clear()
    if request["field"]:
        module, container, field = request["field"]
        _change(importlib.import_module(module), container, field, request["new"])
    begin = sum(os.times()[:4])
    numbers = Numbers(request.get("before"))
    try:
        result = cases.CASES[request["area"]](numbers.take, quick=request["quick"])
    except MovedError:
        return {"moved": True}
    except Exception as error:
        traceback.print_exc()
        return {"failed": f"{type(error).__name__}: {error}"}
    seconds = sum(os.times()[:4]) - begin
    modules = [] if request["field"] else [name for name in sys.modules if name.startswith("tssgeom.")]
    reads = sorted(_READS)
    return {"numbers": result, "taken": numbers.taken, "seconds": seconds, "reads": reads, "modules": modules}


def _change(module: Any, container: str, field: str, new: object) -> None:
    """Change a field of the one instance of a container, in Python and in the core."""
    kind = getattr(module, container)
    del kind.__getattribute__
    new = tuple(new) if isinstance(new, list) else new
    value: Any
    for value in list(vars(module).values()):
        if type(value) is kind and not isinstance(value, tuple):
            object.__setattr__(value, field, new)
        elif type(value) is kind:
            _put(value, kind._fields.index(field), new)
            if module.__name__.startswith("tssgeom.core."):
                fill_core(Path(module.__file__).parent)


def _put(values: tuple[object, ...], at: int, new: object) -> None:
    """Put another item into a tuple where it lies, so that everything that holds the tuple has it."""
    item = ctypes.py_object(new)
    ctypes.pythonapi.Py_IncRef(item)
    ctypes.py_object.from_address(
        id(values) + tuple.__basicsize__ + ctypes.sizeof(ctypes.py_object) * at
    ).value = new
