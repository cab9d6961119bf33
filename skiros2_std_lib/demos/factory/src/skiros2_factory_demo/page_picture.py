"""A picture of the gateway's page, taken by Debian's chromium while the jobs run."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
from pathlib import Path
from typing import Any

from skiros2_common.core.errors import Refused

_SIZE = {"width": 1280, "height": 800}
_TIMEOUT = 60_000.0  # ms, for each part of the page
#: A robot picks something within this time while jobs run (ms).
_PICK_TIMEOUT = 20_000.0

#: Chromium's sandbox does not work for root, and containers have little shared memory. The page is this machine's own.
_ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]


async def take_picture(address: str, token: str, path: Path, is_time: asyncio.Event) -> None:
    """Waits until it is time, then saves the page with the 3D view and the tree of a robot that picks.

    :param address: of the gateway.
    :param token: of a user with the role view: the browser can command nothing. It is not in an address or an argument
        that others can read.
    :param path: of the PNG file.
    :raises Refused: there is no browser, or no page, or it is not shown in time.
    """
    try:
        from playwright.async_api import Error, async_playwright
    except ImportError:
        raise Refused("playwright is not installed (requirements/browser.txt)") from None
    program = shutil.which("chromium")
    if program is None:
        raise Refused("chromium is not installed (Debian's package chromium)")
    try:
        async with async_playwright() as started:
            browser = await started.chromium.launch(executable_path=program, args=_ARGUMENTS)
            await is_time.wait()
            await _save(browser, address, token, path)
            await browser.close()
    except Error as error:
        raise Refused(str(error).partition("\n")[0]) from error


async def _save(browser: Any, address: str, token: str, path: Path) -> None:
    from playwright.async_api import TimeoutError as NotInTime

    context = await browser.new_context(viewport=_SIZE)
    context.set_default_timeout(_TIMEOUT)
    await context.request.post(f"{address}/api/session", data={"token": token})  # sets the context's cookie
    page = await context.new_page()
    answer = await page.goto(address)
    if answer is None or not answer.ok:
        raise Refused(f"{address} has no page: it needs node and npm at the set-up")
    await page.locator('[data-panel="scene"][data-loading="0"] canvas').wait_for()
    await page.locator(".tree .row").first.wait_for()
    with contextlib.suppress(NotInTime):  # the jobs have ended: the last tree is shown
        await page.locator(".tree .row.running", has_text="pick").first.wait_for(timeout=_PICK_TIMEOUT)
    await page.screenshot(path=path)
