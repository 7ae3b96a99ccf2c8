"""Write docs/checks.md from the table of rules in tssgeom/plausibility/rules.py.

python docs/checks.py            # writes the page
python docs/checks.py --check    # is the page that of the table?
"""

import sys
from collections.abc import Iterator
from pathlib import Path

from tssgeom.identify.fit_quality import FIT_TEST
from tssgeom.identify.stated import STATED_TEST
from tssgeom.plausibility.limits import LIMITS as PLAUSIBLE
from tssgeom.plausibility.rules import RULES, Rule
from tssgeom.statistics import EVIDENCE_SCALE

PAGE = Path(__file__).with_suffix(".md")
HEAD = """# Checks

What measured and computed numbers may be. A rule that refuses ends the work on its input with one line; a
rule that warns adds a line, and the work goes on. Each message ends with the name of its rule in brackets.
The same rules hold in every command: those on a run in `check`, `calibrate`, `discover`, `simulate` and
`compensate`, those on a frame wherever frames are read (`analyse`, `batch`, `live`), those on a command in
`compensate` and for targets in `live`, where the frame is rejected. `check` has no rig and no route, and
applies what needs neither. Points of a shape have rules of their own:
[formats.md](formats.md#errors-and-warnings).

`python docs/checks.py` writes this page from `tssgeom/plausibility/rules.py`; the limits, with their
origin, are in `tssgeom/plausibility/limits.py`.
"""


TAIL = f"""
## The fit of `calibrate`

A rig is written where the fit passes its test, or with `--force`. It fails where a channel is met within
more than {FIT_TEST.most_of_range:.0%} of its range and more than {FIT_TEST.most_of_noise:g} × its noise
(rms), where the friction coefficient is above {PLAUSIBLE.most_rig_friction:g}, or where a zero ended at its
bound. An effect that the model lacks leaves up to 5 % of the range on simulated runs; the estimates are
then usable, and `discover` names the effect. Residuals that are not white (Ljung and Box,
p < {EVIDENCE_SCALE.false_alarms:g}) and above {FIT_TEST.sound:g} × the noise show that the model lacks
an effect. Smaller ones also come from the bent scale of a sensor, and from a drive that turns between two
readings. All are reported and widen the intervals; none fails the fit.

Where a friction or compliance that the runs identify is more than {STATED_TEST.most_ratio:g} times what the
rig file states, or less than 1/{STATED_TEST.most_ratio:g} of it, and its interval does not hold that, a
warning has both: the run may not belong to the shape. A number that the file does not state, or that is
"unknown" there, has none.
"""


def page() -> str:
    """Return the page."""
    return "".join([HEAD, *(line for name, rule in RULES.items() for line in _section(name, rule)), TAIL])


def _section(name: str, rule: Rule) -> Iterator[str]:
    yield f"\n## {name}\n\n"
    yield from _wrapped(f"{rule.test[0].upper()}{rule.test[1:]}.")
    yield from _wrapped(
        f"**{'; '.join(f'{subject}: {what}' for subject, what in rule.severity.items())}.** {rule.reason}"
    )
    yield from _wrapped(f"Hint: {rule.hint}.")


def _wrapped(text: str) -> Iterator[str]:
    """Yield an item of a list, in lines of at most 118 characters."""
    line = "-"
    for word in text.split():
        if len(line) + len(word) > 117:
            yield f"{line}\n"
            line = " "
        line = f"{line} {word}"
    yield f"{line}\n"


if __name__ == "__main__":
    if "--check" in sys.argv:
        sys.exit(PAGE.read_text(encoding="utf-8") != page())
    PAGE.write_text(page(), encoding="utf-8")
