"""Guard: what is looked at before the first job and after the last one.

Needs: the names of rules/common.smk and rules/captures.smk. Makes: nothing. Results that can't be written and captures that
changed while the run was under way end it with one message; what a killed run left half written is removed.
"""

from run_guard import check_unchanged, check_writable, remove_unfinished, stamp

STAMPS = {}


def before_the_run():
    """Check that results can be written, clear them of unfinished files, and note how the captures are."""
    try:
        check_writable(RESULTS)
    except InputError as error:
        end_with(error)
    remove_unfinished(RESULTS)
    STAMPS.update((path, stamp(path)) for path in images())


def after_the_run():
    """End with one message where captures are no longer as they were."""
    try:
        check_unchanged(STAMPS)
    except InputError as error:
        end_with(error)


onstart:
    before_the_run()


onsuccess:
    after_the_run()


onerror:
    after_the_run()
