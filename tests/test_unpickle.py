"""The restricted unpickler: Python 2's bytes are read, other names are refused.

What it refuses in results' files is tested in tests/io."""

import os
import pickle

import numpy as np
import pytest
import scipy.sparse

from imocap_core.unpickle import UNREADABLE, load_pickle
from tests.reduced import Reduced


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_python_2_wrote_an_arrays_bytes_as_a_string(protocol: int) -> None:
    values = np.arange(-3.0, 3.0).reshape(2, 3)
    reconstruct, start = values.__reduce__()[:2]
    text = values.tobytes().decode("latin1")
    array = Reduced(reconstruct, start, (1, (2, 3), values.dtype, False, text))
    np.testing.assert_array_equal(load_pickle(pickle.dumps(array, protocol=protocol)), values)


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_names_that_are_not_of_arrays_are_refused(protocol: int) -> None:
    content = pickle.dumps({"sparse": scipy.sparse.csc_matrix(np.eye(2))}, protocol=protocol)
    with pytest.raises(UNREADABLE, match=r"it names (scipy\.sparse|copy_?reg)"):
        load_pickle(content)


@pytest.mark.parametrize(
    "called", [(os.system, ("exit 1",)), (eval, ("1",)), (getattr, (1, "real")), (type, ("x",))]
)
def test_nothing_but_arrays_is_ever_called(called: tuple[object, object]) -> None:
    with pytest.raises(UNREADABLE, match="which is not allowed here"):
        load_pickle(pickle.dumps({"f": Reduced(*called)}))
