"""Make `parameters_paper.json`: the paper's formulation fitted to the authors' data.

Needs the public data of Jindal et al. 2021 (see `camojab.datasets`) and two minutes:

    python data/fit_parameters.py
"""

import datetime
from pathlib import Path

import jax

from camojab import fit, Formulation, Parameters


def main():
    formulation = Formulation.PAPER
    with jax.enable_x64(True):
        start = Parameters(ws=-1e-3, wt=-1e-3, beta=0.36)
        found = fit.fit(fit.jindal2021(), formulation=formulation, start=start)
    assert found.converged, found.verdict
    fit.save_fit(
        Path(__file__).parent / f"parameters_{formulation.value}.json",
        found,
        provenance=(
            "least squares on the 184 values that the published constants were fitted "
            "to (Jindal et al. 2021, Experiment 1; Denes et al. 2020, Experiments 1 "
            "and 3; gfxdisp/ALSaRR d06b3e0), in the scale of Experiment 1, "
            f"{datetime.date.today()}; ca and cb as printed in Denes et al. 2020"
        ),
    )


if __name__ == "__main__":
    main()
