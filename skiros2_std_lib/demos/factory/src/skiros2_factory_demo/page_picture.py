"""Pictures of the gateway's page, taken by Debian's chromium."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from skiros2_common.core.errors import Refused

_SIZE = {"width": 1280, "height": 800}
_TIMEOUT = 60_000.0  # ms, for each part of the page
#: A robot picks something within this time while jobs run (ms).
_PICK_TIMEOUT = 20_000.0

#: Chromium's sandbox does not work for root, and containers have little shared memory. The page is this machine's own.
_ARGUMENTS = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]


class PagePictures:
    """The page in a browser. Its methods raise `Refused` if it does not show what is wanted in time."""

    def __init__(self, page: Any) -> None:
        self._page = page

    async def save_pick(self, path: Path) -> None:
        """Saves the page with the 3D view and the tree of a robot that picks, as a PNG file."""
        with _refused():
            await self._page.locator('[data-panel="scene"][data-loading="0"] canvas').wait_for()
            await self._page.locator(".tree .row").first.wait_for()
            with contextlib.suppress(_error("TimeoutError")):  # the jobs have ended: the last tree is shown
                picking = self._page.locator(".tree .row.running", has_text="pick").first
                await picking.wait_for(timeout=_PICK_TIMEOUT)
            await self._page.screenshot(path=path)

    async def save(self, path: Path, *clicks: str) -> None:
        """Clicks elements one after the other, each named by a selector, saves the page, and closes its dialogs."""
        with _refused():
            for selector in clicks:
                await self._page.locator(selector).first.click()
            await self._page.locator("dialog[open]").last.wait_for()
            await self._page.screenshot(path=path)
            await self._page.evaluate("document.querySelectorAll('dialog[open]').forEach((each) => each.close())")


@contextlib.asynccontextmanager
async def page_pictures(address: str, token: str) -> AsyncIterator[PagePictures]:
    """Opens the page.

    :param address: of the gateway.
    :param token: of a user with the role view: the browser can command nothing. It is not in an address or an argument
        that others can read.
    :raises Refused: there is no browser, or no page.
    """
    try:
        from playwright.async_api import async_playwright
    except ImportError:
        raise Refused("playwright is not installed (requirements/browser.txt)") from None
    program = shutil.which("chromium")
    if program is None:
        raise Refused("chromium is not installed (Debian's package chromium)")
    async with async_playwright() as started:
        with _refused():
            browser = await started.chromium.launch(executable_path=program, args=_ARGUMENTS)
            context = await browser.new_context(viewport=_SIZE)
            context.set_default_timeout(_TIMEOUT)
            await context.request.post(f"{address}/api/session", data={"token": token})  # sets the context's cookie
            page = await context.new_page()
            answer = await page.goto(address)
        if answer is None or not answer.ok:
            raise Refused(f"{address} has no page: it needs node and npm at the set-up")
        yield PagePictures(page)
        await browser.close()


@contextlib.contextmanager
def _refused() -> Any:
    """Raises errors of the browser as `Refused`."""
    try:
        yield
    except _error("Error") as error:
        raise Refused(str(error).partition("\n")[0]) from error


def _error(name: str) -> type[Exception]:
    """Returns a class of playwright's errors. The demo also runs without playwright."""
    from playwright import async_api

    found: type[Exception] = getattr(async_api, name)
    return found
