"""Files as public reports of bugs describe them, each by its bytes: right, or refused by what it is
(SPECTRABOX_DATA names the folder that holds field5/).
"""
import os
from pathlib import Path

import pytest

from benchmarks.ledger import reported


@pytest.mark.parametrize("file, case", [(file, case) for file, cases in reported.PHOTOS.items()
                                        for case in cases])
def test_a_reported_photo_is_read_right_or_refused_by_what_it_is(file, case):
    path = Path(os.environ.get("SPECTRABOX_DATA", "no-data")) / reported.FOLDER / file
    if not path.is_file():
        pytest.skip("SPECTRABOX_DATA names no folder that holds field5")
    assert not reported.wrong(path, case)
