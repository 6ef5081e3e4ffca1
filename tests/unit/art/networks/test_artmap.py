"""ARTMAP with coded objects: an object taught by its code comes back by its code."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.art import InputError
from tests.bench.networks import ARTMAP, FuzzyART, FuzzyARTMAP


def test_an_object_code_taught_through_art_b_comes_back():
    views = np.array([[0.1, 0.2], [0.15, 0.2], [0.9, 0.8]])
    codes = np.array([[0, 0, 1], [0, 0, 1], [0, 1, 0]])
    network = ARTMAP(FuzzyARTMAP(0.9, rho_predict=0.9), FuzzyART(rho=1.0)).partial_fit(views, codes)
    predicted = network.predict([[0.1, 0.21], [0.9, 0.8], [0.5, 0.5]])
    assert predicted[:2].tolist() == [[0, 0, 1], [0, 1, 0]]
    assert np.isnan(predicted[2]).all()


def test_codes_that_are_not_one_a_sample_are_refused():
    with pytest.raises(InputError, match="one row a sample"):
        ARTMAP(FuzzyARTMAP(), FuzzyART(1.0)).partial_fit([[0.1]], [[0, 1], [1, 0]])
