"""Short fits in a few captures, and which of several effects does best in one's place beside all others."""

from gap.search import MAX_STARTS, MIN_GAIN, SCALE_FROM_NEAR, SCALE_FROM_START
from gap.split import probes

FURTHER_ITERATIONS = 3  # of a fit after a change to it


def short_fit(search, effects, poses, scale, iterations=FURTHER_ITERATIONS, moving=None, rough=()):
    """Return the Descent, in a few captures, of all that is free of some effects, or of the parameters ``moving``; everything
    without the effects named ``rough`` first.
    """
    return search.descended(effects, poses, scale, probes(search.train), iterations, moving, rough)


def exchanged(search, end, name, rivals, iterations=FURTHER_ITERATIONS):
    """Return (Descent in which an effect or one of its rivals has its place, whichever leaves least, its name, the others
    [(name, p)] that leave as little): all fitted as long, for so many ``iterations``.
    """
    effects, poses = end.state.effects, end.state.poses
    others = [e for e in effects if e[0] != name]
    ends = {}
    for rival in rivals:
        starts = search.problem.starts_of(rival)[:MAX_STARTS]
        trials = [short_fit(search, [*others, (rival, start)], poses, SCALE_FROM_NEAR, iterations) for start in starts]
        ends[rival] = min(trials, key=loss_of)
    if min(map(loss_of, ends.values())) < end.loss + MIN_GAIN:
        end = min(end, short_fit(search, effects, poses, SCALE_FROM_NEAR, iterations), key=loss_of)
    ends[name] = end
    kept = min(sorted(ends), key=lambda n: ends[n].loss)
    near = [n for n in sorted(ends) if n != kept and ends[n].loss < ends[kept].loss + MIN_GAIN]
    return ends[kept], kept, [(n, dict(ends[n].state.effects)[n]) for n in near]


def or_leader_alone(search, twin, proposal, end, iterations):
    """Return the Descent in which a Proposal was fitted or, where it stuck and leaves more, of what brings most in it, alone."""
    leader = max(proposal.names, key=lambda n: (end.evidence.get(n, 0.0), n))
    effects = [*twin.effects, (leader, dict(proposal.effects)[leader])]
    return min(end, short_fit(search, effects, twin.poses, SCALE_FROM_START, iterations), key=loss_of)


def loss_of(end):
    """Return the loss of a Descent."""
    return end.loss
