"""Tests of widgets are drawn offscreen, unless a platform is chosen."""

from __future__ import annotations

import os

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
