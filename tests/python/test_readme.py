"""The Python of the package's README, run as it is printed."""

import contextlib
import io
import os
import re
import tempfile
import unittest
from pathlib import Path

SOURCE = Path(os.environ["VIABLE_SOURCE_DIR"])


class Readme(unittest.TestCase):
    def test_code_runs_as_it_is_printed(self):
        text = (SOURCE / "tools/python/README.md").read_text(encoding="utf-8")
        blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
        self.assertGreaterEqual(len(blocks), 3)
        # Short runs show the same.
        blocks = [block.replace('"duration_s": 10', '"duration_s": 5').replace("runs=100", "runs=2").replace("4096", "256") for block in blocks]
        self.enterContext(contextlib.chdir(self.enterContext(tempfile.TemporaryDirectory())))
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            os.symlink(SOURCE / "experiments", "experiments")
            os.symlink(SOURCE / "robots", "robots")
            namespace = {}
            for block in blocks:
                try:
                    exec(block, namespace)
                except Exception as error:
                    raise AssertionError(f"this block of the README raised {error!r}:\n{block}") from error
        self.assertIn("limited", printed.getvalue())


if __name__ == "__main__":
    unittest.main()
