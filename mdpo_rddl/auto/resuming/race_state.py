"""All that a race needs to go on in another process, beside its policies."""

import logging
import math
from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from mdpo_rddl.auto.common.arm_log import ArmLog
from mdpo_rddl.auto.common.state import State, count_of, joined
from mdpo_rddl.auto.probing.probing import Probe
from mdpo_rddl.auto.resuming.marks import Marks

logger = logging.getLogger(__name__)

MOST_ARM_BYTES, MOST_BYTES = 2**26, 3 * 2**26
"""Of one arm's tensors, and of all; what is larger is left out."""

_RACE, _PROBE, _ARM = "race", "probe", "arm/"
_COUNTS = ("slices", "iterations")
_SECONDS = ("seconds", "compile_seconds")


@dataclass(frozen=True, eq=False)
class RaceState:
    """Where a race is.

    Attributes:
      seconds: that it has used.
      marks: which of its parts are over, as `Marks` has them.
      contenders: per arm in the rounds its slices, pace and wait.
      logs: per arm what it was given and did.
      exhausted: names of the arms that another slice is of no use for.
      states: per arm what it goes on with; nothing of arms that have no state.
      probe: what probing found; None before that.
    """

    seconds: float
    marks: Mapping[str, Any] = field(default_factory=dict)
    contenders: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    logs: Mapping[str, ArmLog] = field(default_factory=dict)
    exhausted: frozenset[str] = frozenset()
    states: MutableMapping[str, State] = field(default_factory=dict)
    probe: Probe | None = None

    def flat(self) -> State:
        """One flat state, without the arms' states that are too large."""
        parts, used = [], 0
        for name, state in sorted(self.states.items(), key=lambda pair: pair[1].bytes):
            used += state.bytes
            if state.bytes <= MOST_ARM_BYTES and used <= MOST_BYTES:
                parts.append(state.within(_ARM + name))
            else:
                logger.info("%s: its state is too large to be kept", name)
        if self.probe is not None:
            parts.append(self.probe.state().within(_PROBE))
        race = {
            "seconds": self.seconds,
            "marks": dict(self.marks),
            "contenders": {name: dict(one) for name, one in self.contenders.items()},
            "logs": {name: _log_values(log) for name, log in self.logs.items()},
            "exhausted": sorted(self.exhausted),
        }
        return joined(*parts, State({}, {_RACE: race}))

    @classmethod
    def of(cls, flat: State) -> "RaceState":
        """What `flat` has made one state of.

        Raises:
          AttributeError, LookupError, OverflowError, TypeError, ValueError: if it is damaged.
        """
        race, names = flat.values[_RACE], [n for n in flat.values if n.startswith(_ARM)]
        (seconds,) = _finite(race, ("seconds",)).values()
        marks = dict(race["marks"])
        Marks(marks)  # raises if they are none
        return cls(
            seconds=seconds,
            marks=marks,
            contenders={
                str(name): _finite(one, ("slices", "pace", "waited"))
                for name, one in race["contenders"].items()
            },
            logs={str(name): _log(str(name), own) for name, own in race["logs"].items()},
            exhausted=frozenset(map(str, race["exhausted"])),
            states={name.removeprefix(_ARM): flat.part(name) for name in names},
            probe=Probe.of(flat.part(_PROBE)) if _PROBE in flat.values else None,
        )


def _log_values(log: ArmLog) -> dict[str, Any]:
    figures = {name: getattr(log, name) for name in (*_COUNTS, *_SECONDS)}
    return {**figures, "best_return": log.best_return, "details": dict(log.details)}


def _log(name: str, values: Mapping[str, Any]) -> ArmLog:
    best, seconds = values["best_return"], _finite(values, _SECONDS)
    return ArmLog(
        name,
        slices=count_of(values["slices"]),
        seconds=seconds["seconds"],
        compile_seconds=seconds["compile_seconds"],
        iterations=count_of(values["iterations"]),
        best_return=None if best is None else float(best),
        details=dict(values["details"]),
    )


def _finite(values: Mapping[str, Any], names: Sequence[str]) -> dict[str, float]:
    """Finite numbers that are not below 0, by their names."""
    found = {name: float(values[name]) for name in names}
    if not all(math.isfinite(value) and value >= 0.0 for value in found.values()):
        raise ValueError(f"its {', '.join(names)} are not those of a race")
    return found
