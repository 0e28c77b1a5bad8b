"""Results of this folder's tests are compared with those recorded, or recorded anew."""
from pathlib import Path

import pytest
from recorded_results import FOLDER, Record


@pytest.fixture
def recorded(request):
    """Compares a result with the one recorded for this test: ``recorded(result)``."""
    file = FOLDER / f"{Path(request.path).stem}.json"
    return Record(file, request.node.name, request.config.getoption("--record"))
