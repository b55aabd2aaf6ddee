"""The restricted unpickler: Python 2's bytes are read, objects stay inert, other names are refused.

What it refuses in results' and body models' files is tested in tests/io and tests/body."""

import pickle
import sys
import types

import numpy as np
import pytest
import scipy.sparse

from imocap_core.unpickle import UNREADABLE, InertObject, load_pickle
from tests.reduced import Reduced


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_python_2_wrote_an_arrays_bytes_as_a_string(protocol: int) -> None:
    values = np.arange(-3.0, 3.0).reshape(2, 3)
    reconstruct, start = values.__reduce__()[:2]
    text = values.tobytes().decode("latin1")
    array = Reduced(reconstruct, start, (1, (2, 3), values.dtype, False, text))
    np.testing.assert_array_equal(load_pickle(pickle.dumps(array, protocol=protocol)), values)


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_objects_of_named_modules_are_inert_and_all_others_refused(protocol: int) -> None:
    matrix = scipy.sparse.csc_matrix(np.diag([1.0, 2.0]))
    content = pickle.dumps({"sparse": matrix}, protocol=protocol)
    inert = load_pickle(content, inert_modules=("scipy.sparse",))["sparse"]
    assert isinstance(inert, InertObject)
    np.testing.assert_array_equal(inert.state["data"], [1.0, 2.0])
    for modules in ((), ("chumpy",), ("scipy.spars",), ("scipy.sparse.linalg",)):
        with pytest.raises(UNREADABLE, match=r"it names scipy\.sparse"):
            load_pickle(content, inert_modules=modules)


def test_inert_objects_may_refer_to_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    module = types.ModuleType("library")
    node = type("Node", (), {"__module__": "library"})
    module.Node = node  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "library", module)
    first, second = node(), node()
    first.other, second.other, second.x = second, first, np.ones(2)
    inert = load_pickle(pickle.dumps(first), inert_modules=("library",))
    assert inert.state["other"].state["other"] is inert
    np.testing.assert_array_equal(inert.state["other"].state["x"], np.ones(2))
