"""How readable a manual is: length of sentences, share of passives, and words that only this project's authors know.

A measure by regular expressions: the same for every page and every version, and no more than that. A passive is a form
of *be* or *get* before a participle; a sentence ends at a full stop, a colon that ends a line, or a cell of a table.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

WORDS = {
    r"doors?": "frontend",
    r"halls?": "fleet",
    r"upkeep": "maintenance",
    r"(?:left|right|both|two|one|other|which) eyes?|eyes": "camera, cameras",
    r"told|tells|said": "reported, says",
    r"stands? as|stands? until|fault stands|stands there|stands in": "is active, is at, is in",
    r"laid|lay(?:s|ing)? it (?:flat|down)": "placed, registered",
    r"borne(?: out)?": "verified",
    r"settled|sharpened": "converged, refined",
    r"twins?|rivals?": "near-duplicate, competing hypothesis",
    r"sentry": "leak check",
    r"night of misses": "night of failed picks",
    r"agreed to": "confirmed",
    r"denied": "not counted",
    r"the judge": "the independent motion monitor",
    r"acquaintance|introduced": "identification, identified",
    r"house|rooms? (?:of|below|above)": "project, package",
    r"whoever|whatever|thereby|wherein|amid|aslant|besides": "plain words",
    r"(?:are|is) (?:told|said)": "reports, says",
}
"""Words that lead a reader astray, and the field's own."""
ASTRAY = re.compile(r"\b(?:" + "|".join(WORDS) + r")\b", re.IGNORECASE)
IRREGULAR = (
    "begun|bent|born|bought|brought|built|caught|chosen|cut|done|drawn|driven|fed|felt|found|frozen|given|gone|got|held"
    "|hit|kept|known|laid|led|left|lent|let|lost|made|meant|met|paid|proven|put|read|run|said|seen|sent|set|shown|shut"
    "|spoken|spoilt|spent|taken|taught|thought|told|torn|typed|understood|used|woken|won|worn|written"
)
PASSIVE = re.compile(
    r"\b(?:is|are|was|were|be|been|being|gets?|got)\b(?:\s+(?:not|never|then|also|only|first|always|still|again|\w+ly))*"
    rf"\s+(?:\w{{2,}}ed|{IRREGULAR})\b",
    re.IGNORECASE,
)
LONG = 25
"""Words from which a sentence counts as long."""


@dataclass(frozen=True)
class Readability:
    """Of a text: sentences, words, mean and 95th percentile of words in a sentence, the shares of long and of passive
    sentences, and how many words a thousand lead astray."""

    sentences: int
    words: int
    mean: float
    p95: int
    long_pct: float
    passive_pct: float
    astray_per_1000: float


def sentences(markdown: str) -> list[str]:
    """The prose of a page, sentence by sentence: no code, no headings, no links' targets; a cell of a table is one or
    more. A span of code counts as one word."""
    text = re.sub(r"^ *```.*?^ *```", "", markdown, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"<!-- made \w+ -->.*?<!-- end -->", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"`[^`\n]+`", "CODE", text)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    blocks: list[str] = []
    for line in text.splitlines():
        bare = line.strip()
        if bare.startswith("#") or not bare or re.fullmatch(r"[|\s:-]+", bare):
            blocks.append("")
        elif bare.startswith("|"):
            blocks += ["", *(cell.strip() for cell in bare.strip("|").split("|")), ""]
        elif re.match(r"(?:[-*]|\d+\.)\s", bare):
            blocks += ["", re.sub(r"^(?:[-*]|\d+\.)\s+", "", bare)]
        elif blocks and blocks[-1]:
            blocks[-1] += " " + bare
        else:
            blocks.append(bare)
    found = [s for block in blocks for s in re.split(r"(?<=[.!?])\s+(?=[A-Z*(])", block.replace("**", ""))]
    return [s for s in found if len(re.findall(r"[A-Za-z']+", s.replace("CODE", ""))) >= 3]


def words_of(sentence: str) -> list[str]:
    """Words, with numbers, and spans of code as one each."""
    return re.findall(r"[A-Za-z0-9][\w'.,-]*", sentence)


def measured(markdown: str) -> Readability:
    """A page's figures; of a page without prose, zeros."""
    found = sentences(markdown)
    lengths = sorted(len(words_of(s)) for s in found) or [0]
    count, words = max(len(found), 1), sum(lengths)
    astray = sum(len(ASTRAY.findall(s)) for s in found)
    return Readability(
        len(found),
        words,
        words / count,
        lengths[int(0.95 * (len(lengths) - 1))],
        100 * sum(n > LONG for n in lengths) / count,
        100 * sum(bool(PASSIVE.search(s)) for s in found) / count,
        1000 * astray / max(words, 1),
    )
