"""BART on sequences: look where markers were, search the whole frame beside that, keep to a time budget.

A Tracker belongs to one camera and one thread; two trackers in two threads do not touch each other.
"""

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from detectors.bart import PARAMETERS, best_of_each, make_detector
from detectors.bart.filter import PoseFilter
from detectors.bart.motion import MIN_MARKERS, goes_along, rigid_motion, sides_moved
from detectors.bart.track import Track, Tracked
from detectors.contract import DEFAULT_DICTIONARIES, estimate_poses, grey_image

TRACKER_PARAMETERS = {
    # Look first where markers were; False searches every frame whole: no memory, several times slower.
    "regions": True,
    # Search whole frames in a second thread: new markers appear a frame or two late, and no frame waits for them.
    # False searches in the loop, at frames that are known beforehand: repeatable, with slower frames between.
    "asynchronous": False,
    # Frames from one search of the whole frame to the next: fewer find new markers sooner and cost time.
    "full_every": 10,
    # Search the whole frame sooner once what is followed has moved by so many sides of a marker: fewer find what comes
    # into view sooner and cost time while the camera turns. None: only ``full_every`` counts.
    "search_after_sides": 0.5,
    # Milliseconds a frame may take; what is not done by then is left and said (``partial``). None: no limit. A search
    # of the whole frame goes on in the frames after: the smaller, the later new markers appear.
    "budget_ms": None,
    # Frames over which an unseen marker is bridged, extrapolated by its motion: more bridges longer occlusions and
    # reports markers longer that have left. 0 reports only what is seen.
    "bridge_frames": 15,
    # Extrapolate unseen markers by the camera's motion, told by the markers that are seen (needs K and code_m): right
    # where markers stand still. False lets each coast at its own last speed: right where each moves by itself.
    "coast": True,
    # Kalman filter on poses (needs K and code_m); False gives the poses as measured: no lag and more jitter.
    "kalman": True,
    # Choose between the two planar poses by what they were in earlier frames; False takes the better of each frame,
    # which forgets a wrong start at once and turns over now and then.
    "resolve_flips": True,
    # Noise of a corner, pixels: larger smooths more and lags more.
    "corner_noise_px": 0.08,
    # How quickly motion changes at rest, metres and radians a second squared: larger follows faster and smooths
    # less. A move that these do not explain is followed at once, whatever they are.
    "acceleration_m_s2": 0.1,
    "turning_rad_s2": 0.5,
}

LOST_EVERY = 3  # frames from one search of the whole frame to the next while a marker is lost
UNCONFIRMED_FRAMES = 3  # tries to see a marker in the present that was found in an older frame
FOLLOWED_AT_ONCE = 8  # markers between two looks at the clock
LOOK_AGAIN_SIDES = 0.2  # so far from where it was looked for must a marker have been moved to be worth another look


@dataclass(frozen=True)
class Frame:
    """What is known of one frame: ``markers`` (list of Tracked), ``partial`` (the budget ran out), ``ms`` it took."""

    markers: list
    partial: bool
    ms: float


class _Search:
    """A search of one whole image that can stop between its steps; ``frame``: the number of the image."""

    def __init__(self, bart, image, frame):
        self.bart, self.image, self.frame = bart, image, frame
        self.steps, self.found = bart.search_in_steps(image), []

    def step(self):
        """Go on by a step; return whether that was one."""
        found = next(self.steps, None)
        if found is None:
            return False
        self.found = found
        return True

    def result(self):
        """Return (light, detections) of what was found so far."""
        found = best_of_each(self.found)
        light = self.bart.light_of(self.image, found)
        return light, self.bart.finish(self.image, found, light)


class Tracker:
    """Follows the markers of one camera through a sequence.

    K, dist   intrinsics (3 x 3) and OpenCV's distortion coefficients; None: no poses
    code_m    side of the code in metres, or a dict (dictionary, id) -> side; None: no poses
    fps       frames a second, where ``update`` is not told the time
    parameters  of TRACKER_PARAMETERS and of PARAMETERS (bart/__init__.py)
    Raises ValueError for a parameter that neither knows.
    """

    def __init__(self, dictionaries=DEFAULT_DICTIONARIES, K=None, dist=None, code_m=None, fps=30.0, **parameters):
        unknown = set(parameters) - set(TRACKER_PARAMETERS) - set(PARAMETERS)
        if unknown:
            raise ValueError(f"unknown parameters: {', '.join(sorted(unknown))}")
        if not fps > 0:
            raise ValueError(f"fps is positive, not {fps}")
        self.p = {k: parameters.get(k, v) for k, v in TRACKER_PARAMETERS.items()}
        if self.p["budget_ms"] is not None and not self.p["budget_ms"] >= 0:
            raise ValueError(f"budget_ms is not negative, not {self.p['budget_ms']}")
        self.bart = make_detector(tuple(dictionaries), **{k: v for k, v in parameters.items() if k in PARAMETERS})
        self.K, self.dist, self.code_m, self.fps = K, dist, code_m, fps
        sides_moved(np.ones((4, 2)), np.ones((4, 2)), 1.0)  # compiles
        if K is not None:
            PoseFilter.compile()
        self.between_frames = threading.Event()  # set while no frame waits for its result
        self.worker = self.copy = None
        if self.p["asynchronous"]:
            self.worker = ThreadPoolExecutor(max_workers=1)
            self.worker.submit(time.perf_counter).result()  # starts the thread, which takes milliseconds
        self.reset()

    def reset(self):
        """Forget all markers, as for a new sequence."""
        self.tracks = []
        self.shape = self.time_s = None
        self.frame, self.last_search = -1, -(10**9)
        self.light = None  # of the last search, see Bart.light_of
        self.dt, self.moved_sides = 1 / self.fps, 0.0  # since the last frame; since the last search
        self.closing_ms = 0.0  # what it took lately to put a frame's markers together
        self.search = self.next_beside = None  # the _Search at work in the loop; one to be started beside it
        self.beside = None  # the future of the one at work there

    def update(self, image, t_s=None):
        """Return the Frame of the next image; ``t_s`` its time in seconds, else frames follow at ``fps``.

        A change of image size starts anew. Raises ValueError for a bad image and for time that does not advance.
        """
        start = time.perf_counter()
        self.between_frames.clear()
        try:
            partial = self._see(grey_image(image), t_s, start)
            closing = time.perf_counter()
            markers = self._report()
            self._start_search_beside()
        finally:
            self.between_frames.set()
        end = time.perf_counter()
        self.closing_ms = 1000 * (end - closing)
        return Frame(markers, partial, 1000 * (end - start))

    def _see(self, grey, t_s, start):
        """Bring the tracks to this frame; return whether the budget ran out before all was done."""
        self._advance(grey.shape, t_s)
        partial = False
        if self.p["regions"]:
            self._collect()
            partial = self._follow(grey, start)
        if self.search is None and self.beside is None and self._search_is_due():
            self.last_search, self.moved_sides = self.frame, 0.0
            limited = self.p["budget_ms"] is not None
            # With nothing to follow there is nothing to search beside of, unless the budget forbids to wait.
            if self.worker and self.p["regions"] and (self.tracks or limited):
                self.next_beside = _Search(self.bart, self._kept(grey), self.frame)
            else:
                self.search = _Search(self.bart, self._kept(grey) if limited else grey, self.frame)
        if self.search is not None:
            partial |= self._search_on(start)
        return partial

    def _advance(self, shape, t_s):
        """Check size and time of the frame and move all tracks on to it."""
        dt = 1 / self.fps
        if t_s is not None and self.time_s is not None:
            dt = t_s - self.time_s
            if not dt > 0:
                raise ValueError(f"frames out of order: {t_s} s after {self.time_s} s")
        if self.shape is not None and shape != self.shape:
            self.reset()
        self.shape, self.time_s = shape, t_s
        self.frame += 1
        self.dt = dt
        for track in self.tracks:
            track.advance(dt)
        self.moved_sides += self._sides_a_frame()

    def _sides_a_frame(self):
        """Return by how many of its sides a marker moves from frame to frame, median over those followed."""
        if not self.tracks:
            return 0.0
        return float(np.median([sides_moved(t.corners, t.speed, self.dt) for t in self.tracks]))

    def _left(self, start):
        """Return the milliseconds left of the budget before the frame has to be closed."""
        if self.p["budget_ms"] is None:
            return np.inf
        return self.p["budget_ms"] - self.closing_ms - 1000 * (time.perf_counter() - start)

    def _search_is_due(self):
        since = self.frame - self.last_search
        if not self.p["regions"] or not self.tracks or since >= self.p["full_every"]:
            return True
        if self.p["search_after_sides"] is not None and self.moved_sides >= self.p["search_after_sides"]:
            return True
        return since >= LOST_EVERY and any(not track.seen for track in self.tracks)

    def _search_on(self, start):
        """Go on with the search in the loop; return whether the budget ran out before its end."""
        search, more = self.search, True
        while more and self._left(start) > 0:
            more = search.step()
        present = search.frame == self.frame
        # Cut off, it has something to tell only where nothing is followed; else it goes on in the next frame.
        if not more or (present and not (self.tracks and self.p["regions"])):
            self.light, detections = search.result()
            self._take_in(detections, seen=present)
        if not more or not self.p["regions"]:
            self.search = None
        return more

    def _kept(self, grey):
        """Return a copy of the image for later frames, in memory that the last one had."""
        if self.copy is None or self.copy.shape != grey.shape:
            self.copy = np.empty_like(grey)
        np.copyto(self.copy, grey)
        return self.copy

    def _start_search_beside(self):
        """Hand the next search to the second thread; the last thing of a frame, so that none waits for the other."""
        if self.next_beside is not None:
            self.beside = self.worker.submit(self._search_beside, self.next_beside)
            self.next_beside = None

    def _search_beside(self, search):
        """Return the result of a search in the second thread: it halts while a frame waits for its result."""
        more = True
        while more:
            self.between_frames.wait()
            more = search.step()
        return search.result()

    def _collect(self):
        """Take in what the second thread has found, if it is done."""
        if self.beside is not None and self.beside.done():
            self.light, detections = self.beside.result()
            self.beside = None
            self._take_in(detections, seen=False)

    def _take_in(self, detections, seen):
        """Match detections to tracks and start new ones; not ``seen`` are those of an older frame."""
        known = {(t.name, t.id): t for t in self.tracks}
        for d in detections:
            track = known.get((d.dictionary, d.id))
            if track is None:
                track = Track(d, self._new_filter(d), seen)
                self.tracks.append(track)
            elif track.seen:
                continue
            elif seen:
                track.see(d.corners)
            else:
                track.corners = d.corners  # a lost marker: look for it where it was a moment ago
            if seen:
                self._measure(track)

    def _new_filter(self, d):
        side = self.code_m.get((d.dictionary, d.id)) if isinstance(self.code_m, dict) else self.code_m
        if self.K is None or not side:
            return None
        names = ("corner_noise_px", "acceleration_m_s2", "turning_rad_s2", "resolve_flips")
        return PoseFilter(self.K, self.dist, side, *(self.p[name] for name in names))

    def _measure(self, track):
        """Give the track's filter the poses of its corners."""
        if track.filter is None:
            return
        track.poses = estimate_poses(track.corners, track.filter.code_m, self.K, self.dist)
        if track.poses:
            track.filter.update(track.poses, smooth=self.p["kalman"])

    def _follow(self, grey, start):
        """Look for each track near where it is expected; return whether the budget ran out before the end."""
        waiting = sorted(self.tracks, key=lambda t: (t.looked_for, t.missed))
        partial = False
        for k in range(0, len(waiting), FOLLOWED_AT_ONCE):
            partial |= self._look_for(grey, waiting[k : k + FOLLOWED_AT_ONCE], start)
        lost = [track for track in waiting if not track.seen and track.looked_for == self.frame]
        if lost and self.p["coast"] and self.K is not None and self._left(start) > 0:
            self._look_for(grey, self._coast(lost), start)
        for track in waiting:
            if not track.seen:
                track.miss()
        return partial

    def _look_for(self, grey, tracks, start):
        """See those of a batch of tracks that are where they are expected; return whether the budget ran out."""
        if not tracks:
            return False
        if self._left(start) <= 0:
            return True
        quads = np.stack([t.corners for t in tracks])
        found = self.bart.read(grey, quads)
        for track in tracks:
            if self._left(start) <= 0:
                return True
            track.looked_for = self.frame
            mine = [f for f in found if (f["name"], f["id"]) == (track.name, track.id)]
            if not mine:
                around = self.bart.search_near(grey, track.corners, 0.35 + 0.15 * min(track.missed, 6))
                mine = [f for f in around if (f["name"], f["id"]) == (track.name, track.id)]
            if mine:
                track.see(self.bart.finish(grey, mine[:1], self.light)[0].corners)
                self._measure(track)
        return False

    def _coast(self, lost):
        """Move lost tracks with the camera, as far as they went with it before; return those worth another look."""
        seen = [t for t in self.tracks if t.seen and t.before is not None and t.before[2] is not None]
        if len(seen) < MIN_MARKERS:
            return []
        points = np.stack([t.points_before(self.K, self.dist) for t in seen])
        motion = rigid_motion(points, np.stack([t.corners for t in seen]), self.K, self.dist)
        if motion is None:
            return []
        others = [np.stack([t.before[k].mean(axis=0) for t in seen]) for k in (0, 1)]  # centres, speeds
        elsewhere = []
        for track in lost:
            if not track.confirmed or track.before is None or track.before[2] is None:
                continue
            if track.missed == 0:
                centre, speed = track.before[0].mean(axis=0), track.before[1].mean(axis=0)
                track.along = goes_along(centre, speed, *others, self.dt)
            if not track.along:
                continue
            expected = track.corners
            track.coast(motion, self.K, self.dist, self.dt)
            side = np.linalg.norm(expected[1] - expected[0])
            if np.linalg.norm((track.corners - expected).mean(axis=0)) > LOOK_AGAIN_SIDES * side:
                elsewhere.append(track)
        return elsewhere

    def _report(self):
        """Return the markers of this frame; forget those that were missed for too long or have left the image."""
        markers, kept = [], []
        for track in self.tracks:
            longest = self.p["bridge_frames"] if track.confirmed else UNCONFIRMED_FRAMES
            centre = track.corners.mean(axis=0)
            inside = (centre > 0).all() and (centre < self.shape[::-1]).all()
            if not track.seen and (track.missed > longest or not inside):
                continue
            kept.append(track)
            if track.confirmed:
                markers.append(self._tracked(track))
        self.tracks = kept
        return markers

    def _tracked(self, track):
        corners, pose = track.corners, (None, None)
        if track.filter is not None and track.filter.x is not None:
            pose = track.filter.pose()
            if not track.seen and not track.coasted and self.p["kalman"]:
                corners = track.filter.corners()
        return Tracked(track.name, track.id, corners, track.seen, track.poses, *pose)
