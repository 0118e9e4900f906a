#!/usr/bin/env python3
"""Calibration alone, as a method that `score` measures: the prediction-error method (Ljung 1999).

It takes the structure of the rig for right and fits its nominal values, with their tolerances as priors, to
free runs of the records. It names nothing. A method of your own replaces `calibrated` and says more in
`diagnosis.json`; it needs nothing but this command line:

    calibration.py diagnose --rig RIG --fit REC [--fit REC ...] --validate REC [...] --out DIR

Needs numpy, scipy, pandas and the package hil_sim (`pip install ./python`), whose simulator it uses.
"""

import peer


def main():
    case = peer.Case.read(peer.arguments(__doc__))
    fitted, _, _ = peer.calibrated(case)
    after = peer.gap(fitted, case, case.validate)
    verdict = "unexplained" if peer.unexplained(case, after) else "consistent"
    peer.answer(case, fitted, verdict, after=after)


if __name__ == "__main__":
    main()
