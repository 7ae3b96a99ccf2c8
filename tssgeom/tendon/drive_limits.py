"""Commands that stay within the force, the travel and the speed of the drive; docs/model.md (214)."""

from __future__ import annotations
