"""A policy as a file: parameters of a planner, a table of actions, or how plans are made."""

import dataclasses
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from mdpo_rddl.errors import InputError, one_line_cause, printable
from mdpo_rddl.policy.container import (
    Metadata,
    Tensors,
    packed,
    read_container,
    unpacked,
    write_container,
)
from mdpo_rddl.policy.plan_rule import PlanRule, Simulated, parse_rule, rule_text
from mdpo_rddl.policy.table import (
    ActionTable,
    Claim,
    Estimate,
    parse_table,
    table_tensors,
    table_text,
)
from mdpo_rddl.policy.trees import flatten, unflatten
from mdpo_rddl.problem.files import MOST_RDDL_BYTES
from mdpo_rddl.problem.load import Problem
from mdpo_rddl.problem.source import ProblemSource

FORMAT = "mdpo-rddl policy 1"
TABLE_FORMAT = "mdpo-rddl table 2"
ESTIMATE_FORMAT = "mdpo-rddl table 3"
"""Of a table whose return is estimated rather than proven."""
RULE_FORMAT = "mdpo-rddl relaxed plans 1"
_SEEDS = 2**31
_UNDERLYING, _VOTES, _RAISES = "underlying", "votes", "raises"


@dataclass(frozen=True)
class SavedPolicy:
    """What is needed to play a policy again.

    Attributes:
      params: tree of parameters, nested dictionaries of arrays.
      policy_hyperparams: JaxPlan's policy hyperparameters, nested likewise; a preprocessor's may be
        tuples.
      config: the planner's configuration, as a `.cfg` file's text.
      problem: identity of the problem: `domain`, `instance`, `label`, `horizon`, `digest`.
      seed: of the run that trained it.
      source: the problem's texts, with which the file stands alone; None if it has none.
      candidates: what planning judged on the way, in its order, as JSON can hold it.
      underlying: a policy of the underlying MDP, where the state is observed in part only; None if
        there is none.
      votes: whether it is played by a vote of what that policy does.
    """

    params: dict[str, Any]
    policy_hyperparams: dict[str, Any]
    config: str
    problem: dict[str, Any]
    seed: int
    source: ProblemSource | None = None
    candidates: tuple[Mapping[str, Any], ...] = ()
    underlying: "AnySaved | None" = None
    votes: bool = False


@dataclass(frozen=True)
class SavedTable:
    """What is needed to play a table again.

    Attributes:
      table: of actions by state and step.
      claim: what is known of its return.
      problem, source: as in `SavedPolicy`.
      seed: of the run that found it.
    """

    table: ActionTable
    claim: Claim
    problem: dict[str, Any]
    seed: int
    source: ProblemSource | None = None


@dataclass(frozen=True)
class SavedPlanRule:
    """What is needed to play by relaxed plans again.

    Attributes:
      rule: how they are made.
      claim: what simulated episodes have returned.
      problem, source: as in `SavedPolicy`.
      seed: of the run that found it.
    """

    rule: PlanRule
    claim: Simulated
    problem: dict[str, Any]
    seed: int
    source: ProblemSource | None = None


AnySaved = SavedPolicy | SavedTable | SavedPlanRule


def problem_identity(problem: Problem) -> dict[str, Any]:
    """What tells one problem from another."""
    charged = {"error_cost": problem.error_cost} if problem.error_cost else {}
    # nobody may think at the decision then, after loading neither
    raising = {_RAISES: True} if problem.raises else {}
    return {
        **charged,
        **raising,
        "domain": problem.domain_name,
        "instance": problem.instance_name,
        "label": problem.label,
        "horizon": problem.horizon,
        "digest": problem.digest,
    }


def problem_played(saved: AnySaved, problem: Problem) -> Problem:
    """The problem, with what was seen of it when the policy was found.

    Args:
      saved: the policy.
      problem: on which to play it.
    """
    return dataclasses.replace(
        problem,
        raises=problem.raises or saved.problem.get(_RAISES, False),
        error_cost=saved.problem.get("error_cost", problem.error_cost),
    )


def require_same_problem(saved: AnySaved, problem: Problem, source: str) -> None:
    """Raises `InputError` unless a policy was saved for a problem.

    Args:
      saved: the policy.
      problem: on which to play it.
      source: where the policy came from, for the message.
    """
    here = problem_identity(problem)
    if saved.problem.get("digest") != here["digest"]:
        raise InputError(
            f"{source}: saved for {saved.problem.get('label')} "
            f"({saved.problem.get('domain')}/{saved.problem.get('instance')}), "
            f"not for {here['label']} ({here['domain']}/{here['instance']}) as its files are now"
        )


def save_policy(path: Path, policy: AnySaved) -> None:
    """Writes a policy.

    Raises:
      InputError: if the file cannot be written.
      ValueError: if a tree holds anything but nested dictionaries with string keys, and tuples.
    """
    write_container(path, *_contents(policy))


def packed_policy(policy: AnySaved) -> bytes:
    """A policy as its file holds it."""
    return packed(*_contents(policy))


def unpacked_policy(content: bytes, source: str) -> AnySaved:
    """What `packed_policy` has packed.

    Args:
      content: of the file.
      source: where it came from, for error messages.

    Raises:
      InputError: if it is damaged or not such a policy.
      ValueError, LookupError, TypeError: likewise.
    """
    metadata, tensors = unpacked(content, source, _READERS)
    return _READERS[metadata["format"]](metadata, tensors)


def _contents(policy: AnySaved) -> tuple[Tensors, Metadata]:
    """A policy as tensors and text."""
    common = {"problem": json.dumps(policy.problem), "seed": str(policy.seed)}
    if policy.source is not None:
        common["source"] = json.dumps(dataclasses.asdict(policy.source))
    if isinstance(policy, SavedTable):
        text = table_text(policy.table, policy.claim)
        is_estimate = isinstance(policy.claim, Estimate)
        metadata = {"format": ESTIMATE_FORMAT if is_estimate else TABLE_FORMAT, **common, **text}
        return table_tensors(policy.table), metadata
    if isinstance(policy, SavedPlanRule):
        return {}, {"format": RULE_FORMAT, **common, **rule_text(policy.rule, policy.claim)}
    tensors = {
        **flatten(policy.params, "params"),
        **flatten(policy.policy_hyperparams, "hyperparams"),
    }
    if policy.candidates:
        common["candidates"] = json.dumps(policy.candidates)
    if policy.underlying is not None:
        content = packed_policy(policy.underlying)
        tensors[_UNDERLYING] = np.frombuffer(content, np.uint8)
    if policy.votes:
        common[_VOTES] = "true"
    return tensors, {"format": FORMAT, "config": policy.config, **common}


def load_policy(path: Path, within: Path | None = None) -> AnySaved:
    """Reads a policy back, bit for bit.

    Args:
      path: of the file.
      within: a folder that links must not lead out of, if any.

    Raises:
      InputError: naming the file, if it is missing, damaged or not such a policy.
    """
    return _load(path, _READERS, within)


def load_parameters(path: Path) -> SavedPolicy:
    """Reads the parameters of a planner back.

    Raises:
      InputError: as `load_policy` does, and for a table.
    """
    return _load(path, {FORMAT: _parameters})


_Saved = TypeVar("_Saved")


def _load(
    path: Path,
    readers: Mapping[str, Callable[[Metadata, Tensors], _Saved]],
    within: Path | None = None,
) -> _Saved:
    """What the reader of the file's format makes of it."""
    metadata, tensors = read_container(path, readers, within)
    try:
        return readers[metadata["format"]](metadata, tensors)
    except (LookupError, AttributeError, OverflowError, RecursionError, TypeError) as error:
        raise InputError(f"{path}: damaged policy file: {error!r:.200}") from error
    except ValueError as error:
        raise InputError(f"{path}: damaged policy file: {one_line_cause(error)}") from error


def _parameters(metadata: Metadata, tensors: Tensors) -> SavedPolicy:
    trees = unflatten(tensors)
    return SavedPolicy(
        params=trees["params"],
        policy_hyperparams=trees.get("hyperparams", {}),
        config=metadata["config"],
        problem=_identity(metadata),
        seed=_seed(metadata),
        source=_source(metadata),
        candidates=_candidates(metadata),
        underlying=_underlying(tensors),
        votes=_votes(metadata, tensors),
    )


def _underlying(tensors: Tensors) -> AnySaved | None:
    """The policy of the underlying MDP; raises ValueError if it cannot be one."""
    if _UNDERLYING not in tensors:
        return None
    try:
        content = tensors[_UNDERLYING].tobytes()
        metadata, own = unpacked(content, "of the underlying MDP", _READERS)
    except InputError as error:
        raise ValueError(str(error)) from error
    _require(_UNDERLYING not in own, "policy of the underlying MDP")
    return _READERS[metadata["format"]](metadata, own)


def _votes(metadata: Metadata, tensors: Tensors) -> bool:
    """Whether it is played by a vote; raises ValueError if it cannot be."""
    votes = _VOTES in metadata
    _require(not votes or (metadata[_VOTES] == "true" and _UNDERLYING in tensors), "votes")
    return votes


def _identity(metadata: Metadata) -> dict[str, Any]:
    """The problem's identity; raises ValueError if it cannot be one."""
    identity: dict[str, Any] = json.loads(metadata["problem"])
    _require(isinstance(identity, dict), "problem")
    _require(_is_count(identity.get("horizon", 1)), "horizon")
    for name in ("domain", "instance", "label", "digest"):
        _require(isinstance(identity.get(name, ""), str), name)
    cost = identity.get("error_cost", 0.0)
    _require(isinstance(cost, float) and 0.0 <= cost < math.inf, "error_cost")
    _require(isinstance(identity.get(_RAISES, False), bool), _RAISES)
    shown = {"domain", "instance", "label"} & identity.keys()
    return {**identity, **{name: printable(identity[name]) for name in shown}}


def _seed(metadata: Metadata) -> int:
    seed = int(metadata["seed"])
    _require(0 <= seed < _SEEDS, "seed")
    return seed


def _source(metadata: Metadata) -> ProblemSource | None:
    """The problem's texts; raises ValueError if they cannot be read of files either."""
    text = metadata.get("source")
    if text is None:
        return None
    source = ProblemSource(**json.loads(text))
    _require(_is_count(source.horizon), "horizon")
    for name in ("domain", "instance", "label", "domain_text", "instance_text", "functions"):
        value = getattr(source, name)
        if name == "functions" and value is None:
            continue
        # JSON may hold halves of characters, which no file of text does
        is_text = isinstance(value, str) and value == value.encode(errors="replace").decode()
        _require(is_text and len(value) <= MOST_RDDL_BYTES, name)
    return dataclasses.replace(
        source,
        domain=printable(source.domain),
        instance=printable(source.instance),
        label=printable(source.label),
        functions=None if source.functions is None else printable(source.functions),
    )


def _candidates(metadata: Metadata) -> tuple[Mapping[str, Any], ...]:
    """What planning judged; raises ValueError if it cannot be shown."""
    candidates = tuple(json.loads(metadata.get("candidates", "[]")))
    for each in candidates:
        _require(isinstance(each["candidate"], str), "candidates")
        _require(isinstance(each["became_incumbent"], bool), "candidates")
        _require(isinstance(each["mean_return"], int | float | None), "candidates")
        # files of version 0.2.0 have the time
        _require(isinstance(each.get("seconds"), int | float | None), "candidates")
    return tuple({**each, "candidate": printable(each["candidate"])} for each in candidates)


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0


def _require(holds: bool, what: str) -> None:
    if not holds:
        raise ValueError(f"its {what} cannot be what was saved")


def _table(metadata: Metadata, tensors: Tensors) -> SavedTable:
    table, claim = parse_table(tensors, metadata)
    return SavedTable(table, claim, _identity(metadata), _seed(metadata), _source(metadata))


def _plan_rule(metadata: Metadata, tensors: Tensors) -> SavedPlanRule:
    _require(not tensors, "tensors")
    rule, claim = parse_rule(metadata)
    return SavedPlanRule(rule, claim, _identity(metadata), _seed(metadata), _source(metadata))


_READERS: Mapping[str, Callable[[Metadata, Tensors], AnySaved]] = {
    FORMAT: _parameters,
    TABLE_FORMAT: _table,
    ESTIMATE_FORMAT: _table,
    RULE_FORMAT: _plan_rule,
}
