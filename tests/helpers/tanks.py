"""A problem of leaking tanks, as two files."""

from pathlib import Path

# The comments and empty lines, which pyRDDLGym's reader removes, shift its line numbers.
DOMAIN = """\
// A few leaking tanks, filled by hand.

domain tanks {

    types {
        tank : object;
    };


    pvariables {
        CAPACITY(tank) : { non-fluent, real, default = 10.0 };  // m^3
        volume(tank) : { state-fluent, real, default = 5.0 };
        // inflow
        fill(tank) : { action-fluent, real, default = 0.0 };
    };

    cpfs {
        volume'(?t) = min[CAPACITY(?t), volume(?t) + fill(?t)] - Uniform(0.0, 1.0);
    };

    reward = sum_{?t : tank} [volume(?t)];

    action-preconditions {
        forall_{?t : tank} [fill(?t) >= 0.0];
        forall_{?t : tank} [fill(?t) <= CAPACITY(?t) - volume(?t)];
    };
}
"""

INSTANCE = """\
// Two tanks.


non-fluents nf_two {
    domain = tanks;
    objects {
        tank : {t1, t2};
    };
    non-fluents {
        CAPACITY(t2) = 8.0;
    };
}


instance two {
    domain = tanks;
    non-fluents = nf_two;
    init-state {
        volume(t1) = 2.0;
    };
    max-nondef-actions = pos-inf;
    horizon = 7;
    discount = 1.0;
}
"""


def write(folder: Path, domain: str = DOMAIN, instance: str = INSTANCE) -> tuple[str, str]:
    (folder / "tanks.rddl").write_text(domain, encoding="utf-8")
    (folder / "two.rddl").write_text(instance, encoding="utf-8")
    return str(folder / "tanks.rddl"), str(folder / "two.rddl")
