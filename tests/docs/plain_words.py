"""Words and phrases that texts for readers do not use, by the rules of plain technical English.

These are verbs of persons for programs (a node that says or hears), riddles, and words to be decoded. Verbs
of the field replace them: report, receive, request, time out, reopen.
"""

from __future__ import annotations

import re

FIRST_WORDS = re.compile(
    r"(Of|It|Its|That|What|Where|Who|Whose|Whether|How|They|Them|Those|These|This|There|One of|When)\b"
)
"""Openings of a docstring or help text that is not a full phrase."""

IDIOM = re.compile(
    r"\b((is|are|was|were|be|been) told|tells?|hears?|heard|wish(es|ed)?|goes away|"
    r"comes? back|came back|asks? of|believe[sd]?|the rim|for ever|says?|said|anew|reckons?|obeys?|names it|"
    r"leaves with|stands? (beside|here|there)|is the matter|in the midst|makes? up|nothing is lost but|"
    r"whoever|whatever|by itself alone|go(es)? back|went back|(is|are|was|were) away|"
    r"(last|own) words|serves? (on|again)|meant change|from afar|finds? out|all is well|let go)\b".replace(
        " ", r"\s+"
    ),
    re.IGNORECASE,
)
"""Idiomatic words; a phrase may go over the end of a line."""

OLD_PHRASES = re.compile(
    r"the dataset names it|is no (image|video|whole|capture|ring)\b|numbers that are none|"
    r"cannot be made anew|^no host on|Object contains|Invalid enum|\bErrno\b"
)
"""Parts of error messages of earlier versions, and of libraries'."""
