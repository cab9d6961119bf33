"""Clients that are generated from the OpenAPI document, against a gateway with a stand-in cell."""

from __future__ import annotations

import importlib
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import requests

from support.page import NODE
from support.schema_requests import served_gateway
from support.source import ROOT
from unit.skiros2_gateway.conftest import TOKENS

_PROGRAM = ROOT / "tests/support/rest_client/client.ts"
#: npm's packages, which `make setup` installs.
_MODULES = ROOT / ".venv/rest_client/node_modules"
_TSC = ("--strict", "--module", "nodenext", "--target", "es2022", "--lib", "es2022,dom")


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served_gateway(tmp_path_factory.mktemp("gateway")) as address:
        yield address


def _run(*command: str | Path, folder: Path) -> str:
    done = subprocess.run([*map(str, command)], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.long
@pytest.mark.skipif(not (_MODULES.parent / "installed").is_file(), reason="needs npm's packages: make setup")
def test_generated_typescript_client_compiles_and_works(address: str, tmp_path: Path) -> None:
    (tmp_path / "node_modules").symlink_to(_MODULES)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "process.d.ts").write_text("declare const process: { argv: string[] };\n")
    shutil.copy(_PROGRAM, tmp_path)
    generator = _MODULES / "openapi-typescript/bin/cli.js"
    options = ("--output", "api.d.ts", "--default-non-nullable", "false")  # fields with a default may be left out
    _run(NODE, generator, f"{address}/openapi.json", *options, folder=tmp_path)
    _run(NODE, _MODULES / "typescript/bin/tsc", *_TSC, "client.ts", "process.d.ts", folder=tmp_path)
    found = json.loads(_run(NODE, "client.js", address, TOKENS["operate"], folder=tmp_path))
    assert found == {
        "states": ["NotAllowedToStart", "NotAllowedToStart", "Aborted"],
        "ids": ["typescript", "a"],
        "refused": "refused",
        "status": 409,
        "problem": "body.id",
    }


def test_generated_python_client_works(address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document = tmp_path / "openapi.json"
    document.write_text(requests.get(f"{address}/openapi.json", timeout=20.0).text)
    generator = Path(sys.executable).parent / "openapi-python-client"
    _run(generator, "generate", "--path", document, "--meta", "none", "--output-path", "cell_client", folder=tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    client, models = importlib.import_module("cell_client"), importlib.import_module("cell_client.models")
    put_job, apply, jobs, state = (
        importlib.import_module(f"cell_client.api.default.{name}") for name in ("put_job", "apply", "jobs", "state")
    )
    with client.AuthenticatedClient(address, TOKENS["operate"]) as cell:
        order = models.NewJob(id="python", goal="(at robot home)", start=False)
        answers = [put_job.sync_detailed(client=cell, body=order, idempotency_key="python") for _ in range(2)]
        assert [answer.status_code for answer in answers] == [201, 201]
        assert apply.sync("python", "abort", client=cell).state == models.State.ABORTED
        refused = apply.sync("python", "abort", client=cell)
        assert isinstance(refused, models.ProblemDetails) and (refused.status, refused.code) == (409, "refused")
        page = jobs.sync(client=cell, state=[models.State.ABORTED], text="PYTHON")
        assert [job.id for job in page.jobs] == ["python"] and page.next_ is None
        assert {job.id for job in state.sync(client=cell).jobs} >= {"a"}
