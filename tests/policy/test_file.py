"""The policy file: read back bit for bit, or refused in one line."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.mistakes import one_line
from helpers.problems import tiny_files
from safetensors.numpy import save

from mdpo_rddl.policy.container import packed, read_container, write_container
from mdpo_rddl.policy.file import (
    FORMAT,
    SavedPolicy,
    load_policy,
    require_same_problem,
    save_policy,
)
from mdpo_rddl.problem.load import load_problem
from mdpo_rddl.problem.source import ProblemSource

POLICY = SavedPolicy(
    params={
        "params": {
            "Dense_0": {
                "kernel": np.arange(6, dtype=np.float32).reshape(2, 3) / 7,
                "bias": np.array([-0.0, np.nan, np.inf], np.float32),
            },
            "mask": np.array([[True, False]]),
        },
        "counts": np.array([-(2**31), 2**31 - 1], np.int32),
        "step": np.array(7, np.int64),
        "none": np.zeros((0, 3), np.float32),
    },
    policy_hyperparams={"fill": np.array(1.5, np.float32), "set-on": np.array(10.0)},
    config="[Planner]\nmethod='x'  # \u03c3 \U0001f600\n",
    problem={"domain": "tanks", "horizon": 7, "digest": "0" * 64},
    seed=2**31 - 1,
)


def leaves(tree: Any, path: str = "") -> dict[str, tuple[str, tuple[int, ...], bytes]]:
    """Per leaf its type, shape and bytes: equal only for trees that agree bit for bit."""
    if not isinstance(tree, dict):
        return {path: (str(tree.dtype), tree.shape, tree.tobytes())}
    return {
        name: leaf
        for key, value in tree.items()
        for name, leaf in leaves(value, f"{path}/{key}").items()
    }


def refused(path: Path) -> str:
    message = one_line(lambda: load_policy(path))
    assert message.startswith(f"{path}: ")
    return message.removeprefix(f"{path}: ")


def test_a_policy_comes_back_bit_for_bit(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    save_policy(path, POLICY)
    loaded = load_policy(path)

    assert leaves(loaded.params) == leaves(POLICY.params)
    assert leaves(loaded.policy_hyperparams) == leaves(POLICY.policy_hyperparams)
    assert loaded.config == POLICY.config
    assert loaded.problem == POLICY.problem
    assert loaded.seed == POLICY.seed


def test_arrays_that_are_views_come_back_in_their_own_order(tmp_path: Path) -> None:
    matrix = np.arange(12, dtype=np.float32).reshape(3, 4)
    views = {
        "transposed": matrix.T,
        "strided": matrix[::2, ::-1],
        "fortran": np.asfortranarray(matrix),
    }
    save_policy(tmp_path / "views", SavedPolicy(views, {}, "", {}, 0))
    loaded = load_policy(tmp_path / "views").params
    for name, view in views.items():
        np.testing.assert_array_equal(loaded[name], view, strict=True)


def test_hyperparameters_may_be_missing(tmp_path: Path) -> None:
    save_policy(tmp_path / "p", SavedPolicy({"w": np.ones(2)}, {}, "", {}, 0))
    assert load_policy(tmp_path / "p").policy_hyperparams == {}


def test_the_file_is_a_header_of_text_and_the_tensors_bytes(tmp_path: Path) -> None:
    """Read without the library: nothing in the file is a pickle, or anything that executes."""
    path = tmp_path / "policy.safetensors"
    save_policy(path, POLICY)
    data = path.read_bytes()
    end = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:end])
    metadata = header.pop("__metadata__")
    assert set(metadata) == {"format", "config", "problem", "seed", "digest"}
    assert metadata["format"] == FORMAT
    expected = {
        **{f"params{name}": leaf for name, leaf in leaves(POLICY.params).items()},
        **{f"hyperparams{name}": leaf for name, leaf in leaves(POLICY.policy_hyperparams).items()},
    }
    assert set(header) == set(expected)
    for name, entry in header.items():
        start, stop = entry["data_offsets"]
        assert tuple(entry["shape"]) == expected[name][1]
        assert data[end + start : end + stop] == expected[name][2]
    assert len(data) == end + max(entry["data_offsets"][1] for entry in header.values())


@pytest.mark.parametrize("tree", [{1: np.ones(2)}, {"a/b": np.ones(2)}])
def test_a_key_that_no_path_can_hold_is_refused_when_saving(tmp_path: Path, tree: dict) -> None:
    with pytest.raises(ValueError, match="keyed by"):
        save_policy(tmp_path / "p", SavedPolicy(tree, {}, "", {}, 0))
    assert list(tmp_path.iterdir()) == []


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    save_policy(path, POLICY)
    data = path.read_bytes()
    for length in [0, 1, 7, 8, 9, 100, len(data) // 2, len(data) - 1]:
        path.write_bytes(data[:length])
        assert refused(path).startswith("damaged policy file: ")


def test_every_flipped_bit_is_refused(tmp_path: Path) -> None:
    """Wherever it is: in the length, the header's text, the metadata or a tensor."""
    path = tmp_path / "policy.safetensors"
    save_policy(path, SavedPolicy({"w": np.ones(2, np.float32)}, {}, "", {}, 0))
    data = path.read_bytes()
    for bit in range(8 * len(data)):
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        refused(path)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x00" * 100,
        b"\xff" * 100,
        b"a policy, surely\n" * 20,
        np.random.default_rng(0).bytes(1000),
    ],
    ids=["empty", "zeros", "ones", "text", "random"],
)
def test_bytes_that_are_no_such_file_are_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "policy.safetensors"
    path.write_bytes(data)
    assert refused(path).startswith("damaged policy file: ")


def test_bytes_after_the_end_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    save_policy(path, POLICY)
    path.write_bytes(path.read_bytes() + b"\x00")
    assert refused(path).startswith("damaged policy file: ")


@pytest.mark.parametrize("metadata", [None, {}, {"format": "pt"}])
def test_another_programs_file_is_refused(tmp_path: Path, metadata: dict | None) -> None:
    path = tmp_path / "model.safetensors"
    path.write_bytes(save({"weight": np.ones((2, 2), np.float32)}, metadata=metadata))
    found = (metadata or {}).get("format")
    assert refused(path) == f"not a policy of mdpo-rddl (format {found!r})"


def rewritten(
    data: bytes, change: Callable[[dict[str, str], dict[str, np.ndarray]], None]
) -> bytes:
    """The file as another writer would leave it, with something changed."""
    end = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:end])
    metadata = header.pop("__metadata__")
    kinds = {"F32": np.float32, "F64": np.float64, "I32": np.int32, "I64": np.int64, "BOOL": bool}
    tensors = {
        name: np.frombuffer(
            data[end + entry["data_offsets"][0] : end + entry["data_offsets"][1]],
            kinds[entry["dtype"]],
        ).reshape(entry["shape"])
        for name, entry in header.items()
    }
    change(metadata, tensors)
    return save(tensors, metadata=metadata)


CHANGES = {
    "no digest": lambda metadata, tensors: metadata.pop("digest"),
    "no config": lambda metadata, tensors: metadata.pop("config"),
    "no problem": lambda metadata, tensors: metadata.pop("problem"),
    "no seed": lambda metadata, tensors: metadata.pop("seed"),
    "other seed": lambda metadata, tensors: metadata.update(seed="1"),
    "a tensor less": lambda metadata, tensors: tensors.pop("params/step"),
    "a tensor more": lambda metadata, tensors: tensors.update({"params/new": np.ones(1)}),
    "no parameters": lambda metadata, tensors: tensors.clear(),
    "another name": lambda metadata, tensors: tensors.update(
        {"params/stop": tensors.pop("params/step")}
    ),
    "another shape": lambda metadata, tensors: tensors.update(
        {"params/counts": tensors["params/counts"].reshape(1, 2)}
    ),
    "another type": lambda metadata, tensors: tensors.update(
        {"params/counts": tensors["params/counts"].view(np.float32)}
    ),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_file_with_something_missing_or_changed_is_refused(
    tmp_path: Path, change: Callable[[dict[str, str], dict[str, np.ndarray]], None]
) -> None:
    path = tmp_path / "policy.safetensors"
    save_policy(path, POLICY)
    data = path.read_bytes()

    path.write_bytes(rewritten(data, lambda metadata, tensors: None))
    assert leaves(load_policy(path).params) == leaves(POLICY.params)
    path.write_bytes(rewritten(data, change))
    assert refused(path) == "damaged policy file: its contents do not match their digest"


@pytest.mark.parametrize("depth", [63, 20_000])
def test_a_tree_of_too_many_levels_is_refused(tmp_path: Path, depth: int) -> None:
    path = tmp_path / "policy.safetensors"
    name = "params/" + "a/" * depth + "x"
    metadata = {"format": FORMAT, "config": "", "problem": "{}", "seed": "0"}
    write_container(path, {name: np.zeros(1, np.float32)}, metadata)
    assert refused(path).endswith("... has more than 64 parts")
    write_container(path, {"params/" + "a/" * 62 + "x": np.zeros(1, np.float32)}, metadata)
    assert len(leaves(load_policy(path).params)) == 1


def test_a_policy_of_the_underlying_mdp_comes_back_too(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    inner = dataclasses.replace(POLICY, seed=3)
    save_policy(path, dataclasses.replace(POLICY, underlying=inner))
    saved = load_policy(path)
    assert isinstance(saved, SavedPolicy)
    assert isinstance(saved.underlying, SavedPolicy)
    assert (saved.seed, saved.underlying.seed) == (POLICY.seed, 3)
    assert leaves(saved.underlying.params) == leaves(saved.params) == leaves(POLICY.params)
    assert saved.underlying.underlying is None


def test_whether_it_votes_comes_back_too(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    for policy in (POLICY, dataclasses.replace(POLICY, underlying=POLICY, votes=True)):
        save_policy(path, policy)
        assert load_policy(path).votes == policy.votes
    metadata, tensors = read_container(path, [FORMAT])
    write_container(path, tensors, {**metadata, "votes": "perhaps"})
    assert refused(path).endswith("its votes cannot be what was saved")
    # nobody votes without a policy of the underlying MDP
    del tensors["underlying"]
    write_container(path, tensors, metadata)
    assert refused(path).endswith("its votes cannot be what was saved")


def test_what_is_no_policy_of_the_underlying_mdp_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    save_policy(path, dataclasses.replace(POLICY, underlying=POLICY))
    metadata, tensors = read_container(path, [FORMAT])
    good = tensors["underlying"]
    for bad in (good[:-1], np.zeros(3, np.uint8), np.array(1.0, np.float32)):
        write_container(path, {**tensors, "underlying": bad}, metadata)
        assert refused(path).startswith("damaged policy file: of the underlying MDP: damaged")
    # one inside another has no meaning
    inner = packed({**tensors}, metadata)
    nested = np.frombuffer(inner, np.uint8)
    write_container(path, {**tensors, "underlying": nested}, metadata)
    assert refused(path).endswith("its policy of the underlying MDP cannot be what was saved")


def test_control_characters_in_names_are_escaped(tmp_path: Path) -> None:
    path, other = tmp_path / "policy.safetensors", load_problem(*tiny_files(tmp_path))
    evil, shown = "\x1b]0;title\x07", r"\x1b]0;title\x07"
    problem = {"domain": evil, "instance": evil, "label": evil, "digest": "0"}
    candidate = {"candidate": evil, "became_incumbent": True, "mean_return": 1.0}
    source = ProblemSource(evil, evil, "", "", evil, 5)
    save_policy(
        path,
        dataclasses.replace(POLICY, problem=problem, candidates=(candidate,), source=source),
    )
    saved = load_policy(path)
    assert isinstance(saved, SavedPolicy)
    assert saved.candidates[0]["candidate"] == shown
    assert saved.source == ProblemSource(shown, shown, "", "", shown, 5)
    said = one_line(lambda: require_same_problem(saved, other, "here"))
    assert said.startswith(f"here: saved for {shown} ({shown}/{shown}), not for ")


def test_a_text_that_no_file_can_hold_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    source = ProblemSource("d", "i", "// half of one: \ud800", "", "one", 5)
    save_policy(path, dataclasses.replace(POLICY, source=source))
    assert "domain_text" in refused(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    assert refused(tmp_path / "policy.safetensors") == "no such policy"
    assert refused(tmp_path / "a" / "policy.safetensors") == "no such policy"
    assert refused(tmp_path).startswith("damaged policy file: ")
