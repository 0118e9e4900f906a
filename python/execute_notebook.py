"""Executes from_csv_to_effect.ipynb with the installed package; `--pictures DIR` keeps its plots."""

import argparse
import base64
from pathlib import Path

import nbclient
import nbformat

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--pictures", type=Path)
pictures = parser.parse_args().pictures
notebook = nbformat.read(Path(__file__).with_name("from_csv_to_effect.ipynb"), as_version=4)
nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
outputs = [output.get("data", {}) for cell in notebook.cells for output in cell.get("outputs", [])]
plots = [base64.b64decode(data["image/png"]) for data in outputs if "image/png" in data]
assert len(plots) == 2, f"expected two plots, found {len(plots)}"
if pictures:
    pictures.mkdir(parents=True, exist_ok=True)
    for number, plot in enumerate(plots):
        (pictures / f"plot-{number}.png").write_bytes(plot)
print("from_csv_to_effect.ipynb: executed, with 2 plots")
