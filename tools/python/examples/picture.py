"""A picture where matplotlib is there."""

import contextlib


@contextlib.contextmanager
def draw(name):
    """Axes of a picture that is written to the file `name`; without matplotlib it says so, and nothing is drawn."""
    try:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot
    except ImportError:
        from unittest.mock import MagicMock

        print(f"{name}: not drawn, matplotlib is missing (apt-get install python3-matplotlib)")
        yield MagicMock()
        return
    figure, axes = pyplot.subplots(figsize=(8, 4), layout="constrained")
    yield axes
    figure.savefig(name, dpi=120)
    pyplot.close(figure)
    print(f"wrote {name}")
