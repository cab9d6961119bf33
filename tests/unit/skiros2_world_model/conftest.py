"""World models in this process, each with its own workspace."""

from pathlib import Path

import pytest

from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    folder = tmp_path / "workspace"
    folder.mkdir()
    return folder


@pytest.fixture
def model(workspace: Path) -> WorldModel:
    return WorldModel(source_ontologies(), workspace)


@pytest.fixture
def wm(model: WorldModel) -> LocalWorldModel:
    return LocalWorldModel("tester", model)
