"""Widgets are drawn offscreen, unless a platform is set."""

from __future__ import annotations

import os

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
