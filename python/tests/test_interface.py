"""What Python expects of a package: signatures, modules, named tuples, pickles, `repr`, `len` and `in`."""

import copy
import doctest
import inspect
import pickle

import numpy as np
import pytest

import broadcl
from conftest import uniform

PUBLIC = {name: value for name, value in vars(broadcl).items() if name in broadcl.__all__ and callable(value)}
MADE = {"BroadPhase", "Delta", "DeviceBroadPhase"}  # by callers
FUNCTIONS = {name: value for name, value in PUBLIC.items() if not isinstance(value, type)}
METHODS = {
    f"{name}.{method}": value for name, owner in PUBLIC.items() if isinstance(owner, type) and not issubclass(owner, Exception)
    for method, value in vars(owner).items() if callable(value) and not method.startswith("_")
}


@pytest.mark.parametrize("function", [*FUNCTIONS.values(), *METHODS.values()], ids=[*FUNCTIONS, *METHODS])
def test_a_function_has_a_signature_with_types(function):
    signature = inspect.signature(function)
    types = [signature.return_annotation, *(value.annotation for name, value in signature.parameters.items() if name != "self")]
    assert signature.empty not in types
    assert inspect.isroutine(function) and inspect.getdoc(function)


def test_signatures():
    assert str(inspect.signature(broadcl.select_device)) == "(selector: 'str | Device | None' = None) -> 'Device'"
    assert list(inspect.signature(broadcl.BroadPhase).parameters)[:2] == ["device", "algorithm"]
    assert list(inspect.signature(broadcl.BroadPhase.reach).parameters) == ["self", "id"]
    assert list(inspect.signature(broadcl.BroadPhase().reach).parameters) == ["id"]
    assert inspect.signature(broadcl.BroadPhase.update).parameters["layout"].default == "min max"
    for name in MADE:
        assert inspect.signature(PUBLIC[name]).parameters


def test_everything_is_of_the_package():
    for name, value in PUBLIC.items():
        assert value.__module__ == "broadcl" and value.__qualname__ == name
    assert repr(broadcl.Error) == "<class 'broadcl.Error'>"


EXAMPLES = {name: PUBLIC[name] for name in [*sorted(FUNCTIONS.keys() - {"check"}), *sorted(MADE)]}
EXAMPLES |= {name: method for name, method in METHODS.items() if ">>>" in method.__doc__}


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_of_the_docstring(name):
    test = doctest.DocTestParser().get_doctest(EXAMPLES[name].__doc__, {"broadcl": broadcl, "np": np}, name, None, 0)
    assert test.examples
    wrong = []
    doctest.DocTestRunner(verbose=False).run(test, out=wrong.append)
    assert not wrong, "".join(wrong)


def test_a_delta_is_a_named_tuple():
    delta = broadcl.BroadPhase().update(np.zeros((2, 6)))
    assert isinstance(delta, tuple) and delta._fields == ("added", "removed")
    assert delta.added is delta[0] and delta.added.tolist() == [[0, 1]] and delta.removed.shape == (0, 2)
    match delta:
        case broadcl.Delta(added, removed):
            assert added is delta.added and removed is delta.removed
    restored = pickle.loads(pickle.dumps(delta))
    assert type(restored) is broadcl.Delta and np.array_equal(restored.added, delta.added)


def test_a_device_can_be_pickled_and_copied():
    for device in broadcl.devices():
        for other in (pickle.loads(pickle.dumps(device)), copy.copy(device), copy.deepcopy(device)):
            assert other == device and hash(other) == hash(device) and repr(other) == repr(device)
            for name in (name for name in dir(device) if not name.startswith("_")):
                assert getattr(other, name) == getattr(device, name)
        assert broadcl.BroadPhase(device=pickle.loads(pickle.dumps(device)), algorithm="tiles").device == device


def test_functions_and_methods_are_pickled_by_name():
    for function in (*FUNCTIONS.values(), broadcl.BroadPhase.update):
        assert pickle.loads(pickle.dumps(function)) is function


def test_len_and_in():
    broad_phase = broadcl.BroadPhase()
    assert len(broad_phase) == 0 and 0 not in broad_phase
    ids = broad_phase.add(uniform(3))
    broad_phase.remove(1)
    assert len(broad_phase) == 2 and [id in broad_phase for id in ids] == [True, False, True]
    assert -1 not in broad_phase and 2**32 not in broad_phase and 2**80 not in broad_phase
    for wrong in ("0", 0.0, ids):
        with pytest.raises(TypeError, match="integer"):
            wrong in broad_phase  # noqa: B015


def test_what_objects_are_in_a_debugger():
    broad_phase = broadcl.BroadPhase(algorithm="sweep-and-prune", dtype=np.float64)
    broad_phase.add(uniform(3))
    assert repr(broad_phase) == "<broadcl.BroadPhase sweep-and-prune on the host, float64, len 3>"
    device = broadcl.select_device()
    assert f"tiles on {device.id} {device}, float32, len 0" in repr(broadcl.BroadPhase(algorithm="tiles"))
    assert repr(device) == f"<broadcl.Device {device.id} {device}>"
    assert repr(broadcl.BroadPhase().update(np.zeros((2, 6)))).startswith("Delta(added=array([[0, 1]]")
