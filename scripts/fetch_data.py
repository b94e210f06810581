"""Fetch: a campaign's captures from where DVC keeps them; what is lost or damaged there, or why it can't be reached, in a line.

    python scripts/fetch_data.py data/raw/frame.dvc [--remote NAME] [--force]

Like `dvc pull`, but every object's content is compared with its hash, whatever the remote, and the captures are named, not
their hashes. What arrived damaged is not kept; what arrived whole is: a second call goes on from there.
"""

import argparse
import contextlib
import json
import logging
import re
from pathlib import Path

import job
from rig.errors import InputError
from verify_data import MAX_NAMES, md5_of, tracked_md5

log = logging.getLogger("twingap")
LOGGERS = ("dvc", "dvc_data", "dvc_objects")
TRANSFER = "failed to transfer"  # how DVC begins an error of one object


class Kept(logging.Handler):
    """Keeps what is logged as errors, with their causes, as texts in ``said``."""

    def __init__(self):
        super().__init__(logging.ERROR)
        self.said = []

    def emit(self, record):
        """Keep a record's message and the exception that it comes with."""
        cause = record.exc_info[1] if record.exc_info else None
        self.said.append(one_line(f"{record.getMessage()}: {cause}" if cause else record.getMessage()))


@contextlib.contextmanager
def errors_of_dvc():
    """Give the list of what DVC and its parts log as errors meanwhile; nothing of it is shown."""
    kept, before = Kept(), {}
    for name in LOGGERS:
        logger = logging.getLogger(name)
        before[name] = logger.handlers, logger.propagate
        logger.handlers, logger.propagate = [kept], False
    try:
        yield kept.said
    finally:
        for name, (handlers, propagate) in before.items():
            logging.getLogger(name).handlers, logging.getLogger(name).propagate = handlers, propagate


def one_line(text):
    """Return text with its white space as single blanks."""
    return " ".join(str(text).split())


def campaign_of(dvc_file):
    """Return the folder that a .dvc file stands for."""
    return Path(dvc_file).with_suffix("")


def object_file(cache, md5):
    """Return where DVC keeps content in its cache."""
    return Path(cache) / md5[:2] / md5[2:]


def listing_in(cache, tracked):
    """Return {relative path: MD5} of a tracked folder; None where the cache lacks the list or has a damaged one."""
    path = object_file(cache, tracked)
    if not path.is_file():
        return None
    if md5_of(path) != tracked.removesuffix(".dir"):
        path.unlink()
        return None
    return {entry["relpath"]: entry["md5"] for entry in json.loads(path.read_text())}


def drop_damaged(cache, listing):
    """Remove what the cache has of a listing with other content; return the captures' names."""
    damaged = []
    for name, md5 in listing.items():
        path = object_file(cache, md5)
        if path.is_file() and md5_of(path) != md5:
            path.unlink()
            damaged.append(name)
    return damaged


def named(names):
    """Return the first names of a list, and how many more there are."""
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(sorted(names)[:MAX_NAMES]) + more


def what_lacks(listing, cache, damaged, said):
    """Return a sentence on what a fetch did not bring, empty where it brought all.

    damaged  names of captures whose content was another
    said     what DVC logged, one text an error
    """
    lacking = {n: md5 for n, md5 in listing.items() if n not in damaged and not object_file(cache, md5).is_file()}
    whole_remote = [text for text in said if TRANSFER not in text]
    failed = {n for n, md5 in lacking.items() if whole_remote or any(md5 in text for text in said)}
    # What a remote that verifies finds damaged, DVC drops without a word.
    damaged = [*damaged, *(lacking.keys() - failed)]
    parts = [f"damaged on the remote: {named(damaged)}"] if damaged else []
    if failed:
        parts.append(f"did not arrive: {named(failed)} ({reasons_of(said)})")
    return "; ".join(parts)


def reasons_of(said):
    """Return DVC's errors in one line, each once, without the hashes."""
    return "; ".join(dict.fromkeys(re.sub(rf"{TRANSFER} '\w+': ", "", text) for text in said))


def fetch(repo, dvc_file, remote):
    """Have DVC fetch a campaign into its cache; return what lacks then, empty where nothing does."""
    from dvc.exceptions import DownloadError

    tracked, cache = tracked_md5(dvc_file), repo.cache.local.path
    for _ in range(2):  # the second time shows whether the remote's copy is damaged or was this machine's alone
        with errors_of_dvc() as said:
            # The list of captures comes by itself first: DVC keeps it only where all of them have come.
            repo.find_outs_by_path(str(campaign_of(dvc_file)))[0].get_dir_cache(remote=remote)
            with contextlib.suppress(DownloadError):  # the errors before it say more
                repo.fetch(targets=[str(dvc_file)], remote=remote)
        listing = listing_in(cache, tracked)
        damaged = drop_damaged(cache, listing or {})
        if not damaged and (said or listing is not None):
            break
    if listing is None:
        why = f"did not arrive: {reasons_of(said)}" if said else "is missing or damaged on the remote"
        return f"the list of its captures {why}"
    return what_lacks(listing, cache, damaged, said)


def fetch_data(dvc_file, remote=None, force=False):
    """Fetch what a .dvc file tracks and put it in its place; raises InputError naming what is damaged or did not arrive.

    force True lets the tracked files take the place of others in the campaign's folder.
    """
    from dvc.exceptions import ConfirmRemoveError, DvcException
    from dvc.repo import Repo

    if not Path(dvc_file).is_file():
        raise InputError(f"{dvc_file}: no such file; it is the campaign's name with .dvc at its end")
    campaign = campaign_of(dvc_file)
    try:
        with Repo() as repo:
            lacks = fetch(repo, dvc_file, remote)
            if lacks:
                raise InputError(f"{dvc_file}: {lacks}")
            repo.checkout(targets=[str(dvc_file)], force=force)
    except ConfirmRemoveError:
        raise InputError(f"{campaign}: has files that differ; with --force the tracked ones take their place") from None
    except DvcException as error:
        raise InputError(f"{dvc_file}: {one_line(error)}") from None
    log.info("%s: all captures are there", campaign)


def main(argv=None):
    """Read the command line and fetch."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dvc_file", metavar="FILE", help="the campaign's .dvc file")
    parser.add_argument("--remote", help="one of `dvc remote list`; without it the default one")
    parser.add_argument("--force", action="store_true", help="overwrite files of yours that differ")
    options = parser.parse_args(argv)
    job.set_up_log()
    logging.getLogger().setLevel(logging.WARNING)  # of others, such as where credentials were found
    log.setLevel(logging.INFO)
    with job.one_message():
        fetch_data(options.dvc_file, options.remote, options.force)


if __name__ == "__main__":
    main()
