"""Tables of processes that each compiled: a fused sum may differ in its last digit, and a search by more."""

import numpy as np
import pyarrow as pa


def alike(first: pa.Table, second: pa.Table) -> bool:
    """Whether two tables say the same, numbers to one part in a million."""
    return first.schema.equals(second.schema) and all(
        np.allclose(one.to_numpy(), other.to_numpy(), rtol=1e-6, atol=1e-12, equal_nan=True)
        if pa.types.is_floating(one.type)
        else one.to_pylist() == other.to_pylist()
        for one, other in zip(first.columns, second.columns, strict=True)
    )
