"""A problem whose state names objects: the hour of a clock, and where vans are."""

from helpers.toys import problem_from
from mdpo_rddl.problem.load import Problem

DOMAIN = """
domain vans {
    types {
        hour : {@day, @night};
        place : {@p1, @p2, @p3};
        van : object;
    };
    pvariables {
        AFTER(hour) : { non-fluent, hour, default = @day };
        LOAD(hour) : { non-fluent, real, default = 5.0 };
        SAME(hour) : { non-fluent, real, default = 1.0 };
        ROAD(place, place) : { non-fluent, bool, default = false };
        LIMIT(place, van) : { non-fluent, int, default = 2 };
        clock : { state-fluent, hour, default = @day };
        at(van) : { state-fluent, place, default = @p1 };
        waits(place) : { state-fluent, int, default = 1 };
        open(place) : { state-fluent, bool, default = true };
        go(van) : { action-fluent, place, default = @p1 };
        pump : { action-fluent, real, default = 0.0 };
    };
    cpfs {
        clock' = AFTER(clock);
        at'(?v) = if (ROAD(at(?v), go(?v)) ^ open(at(?v))) then go(?v) else at(?v);
        waits'(?p) = waits(?p) + 1;
        open'(?p) = open(?p);
    };
    reward = - abs[LOAD(clock) + SAME(clock) - pump]
             - (sum_{?v : van} [max[waits(at(?v)) - LIMIT(at(?v), ?v), 0]]);
    action-preconditions {
        pump >= 0.0;
        pump <= 10.0;
    };
}
non-fluents nf {
    domain = vans;
    objects { van : {v1, v2}; };
    non-fluents { AFTER(@day) = @night; LOAD(@night) = 9.0; ROAD(@p1, @p2); ROAD(@p2, @p3);
                  LIMIT(@p1, v2) = 3; LIMIT(@p3, v1) = 7; };
}
instance one {
    domain = vans;
    non-fluents = nf;
    max-nondef-actions = pos-inf;
    horizon = 6;
    discount = 1.0;
}
"""


def vans() -> Problem:
    """The problem."""
    return problem_from(DOMAIN)
