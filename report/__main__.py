"""python3 -m report DIR: makes DIR/report.html and DIR/figures/ from the study in DIR."""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path

import matplotlib

from report.key_frames import draw
from report.page import page
from report.recording import read_recordings
from report.static_figures import save_all
from report.study import StudyError, read_study
from report.verdict import headline


def make(folder: Path) -> Path:
    """Makes the report; an existing one is replaced only when everything is done."""
    matplotlib.use("Agg")
    study = read_study(folder)
    recordings = read_recordings(folder, study.scenarios)
    images = {r.scenario: [draw(r, frame) for frame in r.key_frames] for r in recordings}
    with tempfile.TemporaryDirectory(dir=folder, prefix=".report-") as beside:
        made = Path(beside)
        (made / "figures").mkdir()
        save_all(study, recordings, images, made / "figures")
        (made / "report.html").write_text(page(study, recordings, images), encoding="utf-8")
        shutil.rmtree(folder / "figures", ignore_errors=True)
        os.replace(made / "figures", folder / "figures")
        os.replace(made / "report.html", folder / "report.html")
    print(" ".join(headline(study)).replace("`", ""))
    return folder / "report.html"


def main() -> int:
    """Runs the command line; returns the exit status."""
    if len(sys.argv) != 2:
        print("usage: scripts/report DIR", file=sys.stderr)
        return 2
    try:
        made = make(Path(sys.argv[1]))
    except (StudyError, OSError) as error:
        print(f"report: {error}", file=sys.stderr)
        return 1
    print(f"\nThe page: '{made}' ({made.stat().st_size / 1e6:.1f} MB); its figures: '{made.with_name('figures')}'")
    return 0


if __name__ == "__main__":
    sys.exit(main())
