"""A file of an own effect may do anything while it runs; it gets one line."""

import pytest

from sysid.effects._own import read
from sysid.errors import SysidError

SILENT = "class Silent(BaseException):\n    def __str__(self):\n        raise Silent()\nraise Silent()\n"


@pytest.mark.parametrize(
    "text", ["import sys; sys.exit(3)", "raise KeyboardInterrupt", "exit()", SILENT, "EFFECT = 3"]
)
def test_an_effect_file_that_exits_is_refused_in_one_line(tmp_path, text):
    path = tmp_path / "mine.py"
    path.write_text(text)
    with pytest.raises(SysidError) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
