"""Filters of one tendon or of a machine as objects for JSON, and back to the last bit."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import msgspec

from tssgeom.adapt.saved import SavedFilter, checked_filter
from tssgeom.adapt.saved_machine import SavedMachineFilter, checked_machine
from tssgeom.adapt.saved_parts import VERSION, plain
from tssgeom.errors import SettingsError
from tssgeom.rig import Rig

Saved = SavedFilter | SavedMachineFilter


def filter_object(saved: Saved) -> dict[str, Any]:
    """Return a filter as an object for JSON, from which `filter_of` makes the same to the last bit."""
    values = {field.name: plain(getattr(saved, field.name)) for field in fields(saved)}
    return values | {"version": VERSION, "random": [f"{number:x}" for number in saved.random]}


def filter_of(saved: Any, rig: Rig) -> Saved:
    """Return what `filter_object` wrote.

    Raises
    ------
    SettingsError
        Where it is of another version, is none of a filter, or follows other numbers than the rig names.
    """
    try:
        version = saved.get("version")
        if version != VERSION:
            raise SettingsError(
                f"the saved filter has version {version!r}, this program reads {VERSION}: it is not used"
            )
        return checked_machine(saved, rig) if rig.is_machine else checked_filter(saved, rig)
    except SettingsError:
        raise
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, msgspec.MsgspecError) as error:
        raise SettingsError(f"the saved filter is broken ({error!r}): it is not used") from error
