"""Builds the compiled core: constants and prototypes to code, C to one shared library.

`hook.py` calls it for `pip`. In an editable installation `tssgeom.core` calls `build` when a source is newer
than the library. Nothing of this module is needed, or shipped, in a wheel.
"""

from __future__ import annotations

import contextlib
import os
import platform
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
FLAGS = [
    *("-std=c11", "-O3", "-fPIC", "-shared", "-fvisibility=hidden"),
    *("-Wall", "-Wextra", "-Wno-psabi", "-Wno-vla-parameter", "-Werror=implicit-function-declaration"),
    # sums are neither fused nor reordered, so that every processor and compiler gives the same digits
    *("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"),
]
_C_TYPES = {"float": "double", "int": "int64_t", "bool": "int64_t"}


class NoCompilerError(RuntimeError):
    """Neither a C compiler nor the package `ziglang` is installed."""


def sources() -> list[Path]:
    """Files on which the library depends."""
    return sorted(
        path for kind in ("*.c", "*.h", "*.inl", "constants*.py", "build.py") for path in HERE.glob(kind)
    )


def is_stale(folder: Path) -> bool:
    """Whether a library of a folder is missing, or older than a source."""
    made = [folder / name for name in library_flags()]
    newest = max(each.stat().st_mtime for each in sources())
    return any(not each.exists() or each.stat().st_mtime < newest for each in made)


def build(folder: Path, *, flags: list[str] | None = None, target: str | None = None) -> list[Path]:
    """Put the library and its generated Python into a folder.

    Parameters
    ----------
    folder
        Where the files go; they replace those of an earlier build in one step each.
    flags
        Compiler flags beside the usual ones, such as sanitizers.
    target
        A `zig` target such as `aarch64-linux-gnu.2.17` to build for another machine.

    Raises
    ------
    NoCompilerError
        Where there is none.
    """
    with tempfile.TemporaryDirectory(dir=folder) as name:
        work = Path(name)
        (work / "constants.h").write_text(constants_header(), encoding="utf-8")
        command, files = compiler(target), [str(each) for each in sorted(HERE.glob("*.c"))]
        end = [] if "windows" in (target or sys.platform) or sys.platform == "win32" else ["-lm"]
        libraries = {work / name: more for name, more in library_flags(target).items()}
        commands = [
            [
                *command,
                *FLAGS,
                *more,
                *(flags or []),
                "-I",
                str(work),
                "-I",
                str(HERE),
                *files,
                "-o",
                str(path),
                *end,
            ]
            for path, more in libraries.items()
        ]
        with ThreadPoolExecutor() as pool:
            list(pool.map(_run, commands))
        texts = (Path(path).read_text(encoding="utf-8") for path in files)
        prototypes = [each for text in texts for each in read_prototypes(text)]
        _emit_declarations(prototypes, work / "_declarations.py")
        (work / "_entries.py").write_text(_entries(prototypes), encoding="utf-8")
        built = (work / "_declarations.py", work / "_entries.py", *libraries)
        return [path.replace(folder / path.name) for path in built]


def library_flags(target: str | None = None) -> dict[str, list[str]]:
    """Return the libraries of a machine and the flags of each: one for any, and on x86-64 one for AVX2.

    Both give the same digits, since sums are neither fused nor reordered.
    """
    windows = "windows" in target if target else sys.platform == "win32"
    end = ".dll" if windows else ".so"
    x86 = "x86_64" in target if target else platform.machine().lower() in ("x86_64", "amd64")
    return {f"_core{end}": []} | ({f"_core_avx2{end}": ["-mavx2"]} if x86 else {})


def _run(command: list[str]) -> None:
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode:
        raise RuntimeError(f"the core does not compile:\n{shlex.join(command)}\n{made.stderr}")
    if made.stderr:
        sys.stderr.write(made.stderr)  # warnings of the compiler


def compiler(target: str | None = None) -> list[str]:
    """Return the command of a C compiler: that of the system, or else zig's.

    Raises
    ------
    NoCompilerError
        Where there is none.
    """
    if target is None and (system := system_compiler()):
        return system
    try:
        import ziglang  # noqa: F401  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise NoCompilerError("no C compiler: install one (gcc, clang) or `pip install ziglang`") from None
    zig = [sys.executable, "-m", "ziglang", "cc", "-mcpu=baseline", "-fno-sanitize=undefined", "-g0"]
    return zig if target is None else [*zig, "-target", target]


def system_compiler() -> list[str] | None:
    """Return the command of the system's C compiler, or that of `CC`; None where there is none."""
    chosen = os.environ.get("CC")
    if chosen:
        return shlex.split(chosen)
    return next(([path] for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)


def constants_header() -> str:
    """Write the tuned numbers of `constants*.py` as C, each container as one constant structure."""
    lines = ["/* Generated from constants*.py. */", "#pragma once", "#include <stdint.h>"]
    containers: dict[str, Any] = {}
    for path in sorted(HERE.glob("constants*.py")):
        containers.update(
            {name: value for name, value in runpy.run_path(str(path)).items() if name.isupper()}
        )
    for name, value in containers.items():
        kinds = {field: _C_TYPES[type(getattr(value, field)).__name__] for field in value._fields}
        fields = " ".join(f"{kind} {field};" for field, kind in kinds.items())
        numbers = ", ".join(
            float(number).hex() if kind == "double" else str(int(number))
            for number, kind in zip(value, kinds.values(), strict=True)
        )
        lines.append(f"__attribute__((unused)) static const struct {{ {fields} }} {name} = {{ {numbers} }};")
    return "\n".join([*lines, ""])


class Parameter:
    """One parameter of an entry: `[OUT|INOUT|OPTIONAL|WORK] [const] type name[shape]…`."""

    def __init__(self, text: str) -> None:
        match = re.fullmatch(
            r"(?:(?P<role>OUT|INOUT|OPTIONAL|WORK) )?(?P<const>const )?(?P<type>double|int64_t|uint8_t|char) "
            r"(?P<star>\*)?(?P<name>\w+)(?P<shape>(?:\[[^\]]+\])*)",
            text.strip(),
        )
        if match is None:
            raise ValueError(
                f"a parameter of an entry of the core is not in the form of its conventions: {text!r}"
            )
        self.role = match["role"] or ""
        self.type, self.name, self.scalar_out = match["type"], match["name"], bool(match["star"])
        self.shape = re.findall(r"\[([^\]]+)\]", match["shape"])
        if self.shape and not self.role and not match["const"]:
            raise ValueError(f"{self.name} is changed: mark it OUT, INOUT or WORK")

    @property
    def pointer(self) -> bool:
        """Whether it is passed by address."""
        return bool(self.shape) or self.scalar_out

    @property
    def annotation(self) -> str:
        """Its type in Python."""
        if self.shape:
            return "np.ndarray | None" if self.role == "OPTIONAL" else "np.ndarray"
        return _PYTHON_TYPES[self.type]


class Prototype:
    """One entry of the core."""

    def __init__(self, returns: str, name: str, parameters: str, doc: str) -> None:
        self.returns, self.name, self.doc = returns, name, doc
        each = [] if parameters == "void" else re.split(r",(?![^\[]*\])", parameters)
        self.parameters = [Parameter(text) for text in each]


def read_prototypes(source: str) -> list[Prototype]:
    """Read the entries of a file: a comment `/** … */` before `ENTRY type tss_name(…) {`."""
    pattern = (
        r"/\*\*(?P<doc>(?:(?!\*/).)*)\*/\s*"
        r"ENTRY (?P<returns>\w+) tss_(?P<name>\w+)\((?P<parameters>[^;{]*)\) \{"
    )
    prototypes = [
        Prototype(
            each["returns"], each["name"], " ".join(each["parameters"].split()), _sentences(each["doc"])
        )
        for each in re.finditer(pattern, source, re.DOTALL)
    ]
    if len(prototypes) != source.count("\nENTRY "):
        raise ValueError("every ENTRY needs a comment /** … */ before it")
    return prototypes


def _sentences(comment: str) -> str:
    lines = [re.sub(r"^\s*\* ?", "", line).rstrip() for line in comment.strip().splitlines()]
    return "\n".join(lines).strip()


def _emit_declarations(prototypes: list[Prototype], path: Path) -> None:
    """Write what cffi needs to call the entries, so that no C is parsed when the package is imported."""
    from cffi import FFI

    ffi = FFI()
    for each in prototypes:
        kinds = ", ".join("void *" if one.pointer else one.type for one in each.parameters)
        returns = "int" if each.returns == "status" else each.returns
        ffi.cdef(f"{returns} tss_{each.name}({kinds});")
    ffi.set_source("_declarations", None)
    with contextlib.redirect_stdout(None):  # it says that it writes a file
        ffi.emit_python_code(str(path))


_ENTRIES = '''"""The entries of the core as functions of arrays. Generated from C by build.py."""

# ruff: noqa
import numpy as np

from tssgeom.core.binding import C1, F8, I8, NULL, U1, array, empty, failed
from tssgeom.core.binding import from_buffer, library, new, scratch, wrong

'''
_PYTHON_TYPES = {"double": "float", "int64_t": "int"}
_SHORT = {"double": "F8", "int64_t": "I8", "uint8_t": "U1", "char": "C1"}


def _entries(prototypes: list[Prototype]) -> str:
    return _ENTRIES + "\n\n".join(_entry(each) for each in prototypes) + "\n"


def _entry(each: Prototype) -> str:
    """Write one entry: sizes follow from the arrays, results are made and returned, `work` is handed in."""
    parameters = each.parameters
    inputs = [one for one in parameters if one.shape and one.role in ("", "INOUT", "OPTIONAL")]
    sizes = {one.name for one in parameters if one.type == "int64_t" and not one.pointer}
    inferred: dict[str, str] = {}
    for one in sorted(inputs, key=lambda one: one.role == "OPTIONAL"):
        if one.role == "OPTIONAL":
            continue
        for axis, size in enumerate(one.shape):
            if size in sizes and size not in inferred:
                inferred[size] = f"{one.name}.shape[{axis}]"
    given = [one for one in parameters if one in inputs or not (one.pointer or one.name in inferred)]
    body = []
    for one in inputs:
        short = _SHORT[one.type]
        check = f"if {one.name}.dtype is not {short} or not {one.name}.flags.c_contiguous:"
        convert = f"{one.name} = array({one.name}, {short}, {one.role == 'INOUT'})"
        if one.role == "OPTIONAL":
            check = f"if {one.name} is not None and ({check[3:-1]}):"
        body += [check, f"    {convert}"]
    body += [f"{size} = {source}" for size, source in inferred.items()]
    for one in inputs:
        shape = _tuple(one.shape)
        condition = f"{one.name} is not None and " if one.role == "OPTIONAL" else ""
        body += [f"if {condition}{one.name}.shape != {shape}:"]
        body += [f'    wrong("{each.name}", "{one.name}", {one.name}.shape, {shape})']
    results, arguments = [], []
    for one in parameters:
        if one.role == "OUT" and one.scalar_out:
            body.append(f'{one.name} = new("{one.type} *")')
            results.append(f"{one.name}[0]")
            arguments.append(one.name)
        elif one.role == "OUT":
            body.append(f"{one.name} = empty({_tuple(one.shape)}, {_SHORT[one.type]})")
            results.append(one.name)
            arguments.append(f"from_buffer({one.name})")
        elif one.role == "WORK":
            size = " * ".join(f"({part})" for part in one.shape)
            arguments.append(f'scratch("{one.name}", 8 * {size})')
        elif one.role == "OPTIONAL":
            arguments.append(f"None if {one.name} is None else from_buffer({one.name})")
        elif one.pointer:
            writable = ", require_writable=True" if one.role == "INOUT" else ""
            arguments.append(f"from_buffer({one.name}{writable})")
        else:
            arguments.append(one.name)
    arguments = [each.replace("None if", "NULL if") for each in arguments]
    call = f"library.tss_{each.name}({', '.join(arguments)})"
    if each.returns == "status":
        body += [f"status = {call}", "if status:", f'    failed(status, "{each.name}")']
    elif each.returns == "void":
        body.append(call)
    else:
        body.append(f"returned = {call}")
        results.insert(0, "returned")
    if results:
        body.append("return " + ", ".join(results))
    doc = f'"""{each.doc}"""'.replace("\n", "\n    ")
    annotated = ", ".join(f"{one.name}: {one.annotation}" for one in given)
    lines = [f"def {each.name}({annotated}) -> {_returned(each)}:", f"    {doc}"]
    return "\n".join(lines + [f"    {line}" for line in body]) + "\n"


def _returned(each: Prototype) -> str:
    """Write the type of what an entry returns."""
    types = [] if each.returns in ("status", "void") else [_PYTHON_TYPES[each.returns]]
    types += [one.annotation for one in each.parameters if one.role == "OUT"]
    return "None" if not types else types[0] if len(types) == 1 else f"tuple[{', '.join(types)}]"


def _tuple(sizes: list[str]) -> str:
    return f"({', '.join(sizes)},)"
