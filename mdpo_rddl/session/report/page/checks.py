"""What the page uses of a run's JSON files, and of what kind each value is."""

from collections.abc import Mapping
from typing import Any

from mdpo_rddl.session.report.page.shapes import (
    absent_or,
    anything,
    count,
    entries,
    fields,
    name,
    number,
    table,
    text,
    truth,
)

_RETURN = absent_or(number)
_INTERVAL = absent_or(entries(_RETURN, 2, 2))
_RETURNS = {"returns": entries(_RETURN, 1)}
_TERM = fields(
    {"text": text, "size": number, "cost": _RETURN, "cost_error": _RETURN},
)
_EQUATION = fields({"head": text, "within": text, "terms": entries(_TERM)})
_ARM = fields(
    {"seconds": number, "iterations": count, "best_return": _RETURN},
    {"compile_seconds": number},
)
_CANDIDATE = fields({"seconds": number, "mean_return": _RETURN, "became_incumbent": truth})
_RACE = fields(
    {
        "arms": table(_ARM),
        "arm": text,
        "chosen": text,
        "noop_return": _RETURN,
        "random_return": _RETURN,
        "candidates": entries(_CANDIDATE),
    },
    {"parents": absent_or(entries(text))},
)
_THOUGHT = fields(
    {
        "left_base": count,
        "decisions": count,
        "plain_mean_return": _RETURN,
        "realised_gain": _RETURN,
        "expected_gain": _RETURN,
    }
)
_THINKING = fields(
    {"decision_seconds": absent_or(number), "method": absent_or(text), "reason": absent_or(text)}
)
_SUMMARY = fields(
    {
        "label": name,
        "domain": name,
        "instance": name,
        "horizon": count,
        "config": text,
        "policy": text,
        "seed": count,
        "mean_return": _RETURN,
        "illegal_actions": count,
        **_RETURNS,
    },
    {
        "ci95": _INTERVAL,
        "noise": text,
        "noise_parameters": table(anything),
        "fallback_actions": count,
        "references": absent_or(
            table(absent_or(fields(_RETURNS, {"ci95": _INTERVAL, "simulated": truth}))),
        ),
        "optimum": fields({"value": number, "states": count}),
        "rule": absent_or(fields({"equations": entries(_EQUATION), "note": text})),
        "thinking": absent_or(_THINKING),
        "decision_seconds": absent_or(number),
        "simulated_episodes": absent_or(count),
        "train_seconds": number,
        "compile_seconds": number,
        "warnings": entries(text),
        "versions": table(text),
    },
)
_CONFIG = fields({}, {"sections": absent_or(table(table(anything)))})


def check_summary(summary: Any) -> None:
    """Checks what the page uses of `summary.json`.

    Raises:
      ValueError: that names the key.
    """
    _SUMMARY(summary, "")
    if "train_seconds" in summary:
        fields({"compile_seconds": number})(summary, "")
    if summary["illegal_actions"]:
        fields({"fallback_actions": count})(summary, "")
    race = summary.get("auto")
    # before version 0.2 it had no arms, and is not shown
    if race and (not isinstance(race, Mapping) or "arms" in race):
        _RACE(race, "auto")
    thinking = summary.get("thinking")
    if thinking and thinking["method"]:
        _THOUGHT(thinking, "thinking")


def check_config(config: Any) -> None:
    """Checks what the page uses of `config.json`.

    Raises:
      ValueError: that names the key.
    """
    _CONFIG(config, "")
