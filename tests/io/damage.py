"""Files cut open, and something else put in: what fuzz tests feed to readers."""

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

quick = settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@st.composite
def damage(draw: st.DrawFn) -> tuple[float, float, bytes]:
    """Where a file is cut open, how much of it goes, and what comes there."""
    share = st.floats(0.0, 1.0, exclude_max=True)
    words = st.sampled_from(
        [b"", b",", b"\n", b"\x00", b"-", b"1e999", b"nan", b"9" * 30, b"[" * 50, b'"', b"\xff\xfe"]
    )
    return draw(share), draw(st.one_of(st.just(0.0), share)), draw(st.one_of(words, st.binary(max_size=12)))


def damaged(raw: bytes, where: tuple[float, float, bytes]) -> bytes:
    at = int(where[0] * len(raw))
    gone = int(where[1] * (len(raw) - at))
    return raw[:at] + where[2] + raw[at + gone :]
