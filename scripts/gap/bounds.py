"""The numbers that decide a name or a verdict, all of them (docs/bounds.md: what half and double of each would turn).

What else is compared with a number in this folder saves time, or is a scale or a floor.
"""

MIN_GAIN = 25.0  # loss gained, or lost without: less is no name; five standard deviations of one parameter
CLEAR_GAIN = 16 * MIN_GAIN  # loss that no refit makes up for
CHARGE = 2.0  # loss that each parameter must gain besides, as Akaike's
MIN_STATION_LOSS = 3.0  # loss from which a station speaks against a name; or 2 % of the whole gain
CERTAIN = 3.0  # standard errors of a parameter, or of a gain held out: 0.3 % by chance

# Shares of a whole
LITTLE = 0.15  # of what is open: what gains no more is a patch on a wrong form
CLOSED = 0.2  # of what was open at first, left by a form that is not quite the camera's; twice as much is hardly closed
MOST = 0.5  # of what was open: what explains less of it does not tell what it is
RIVAL_SHARE = 0.7  # of what the best name brings, from which another of its kind is held against it
MIN_STATIONS = 0.7  # of those held out, that must not lose by a name: a highlight is not seen from everywhere
MIN_SHARE_OF_LIGHT = 0.95  # of what an effect changes, that another light does as well: then it does not compete

MAX_FLOOR_GAP = 1.1  # gap, in floors, that is the floor: floors are estimates themselves
MAX_FLOOR = 1.5  # floors of repeats, and a gap of noise, that are the camera's own: more is a twin that is still wrong
TWICE = 2.0  # floors, losses or standard errors apart: farther is another thing, nearer may be the same
MAX_TIMES_OFF = 4.0  # times the usual residual of its set: a capture farther off is left out

MAX_PARAMETERS = 12  # of an effect that can be told: more make a free warp
MAX_SIMPLE = 3  # of an effect of one form, with which little else can be mimicked
MANY = 3  # effects proposed at once that are sought together: fewer are told better one by one

MAX_P = 0.01  # share of divisions of the captures that are as telling, up to which something has changed
