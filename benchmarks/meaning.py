"""How often the meaning of a name tells what a part does: on the words whose roles are listed.

    python benchmarks/meaning.py --json

The list itself is not asked. Needs the extra ``names``. The sentences were written once, before
this was first run, and not changed after it.
"""

from __future__ import annotations

import argparse
import json

from articulate.reconstruct.actors.semantic.embeddings import FLOOR, MiniLM, meant_role
from articulate.reconstruct.actors.semantic.ontology import ROLES


def main() -> None:
    """Print shares."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print the result as JSON alone")
    flags = parser.parse_args()
    encoder = MiniLM()
    said = {word: meant_role(word, encoder) for word in ROLES}
    answered = [word for word in ROLES if said[word] != "unknown"]
    right = [word for word in answered if said[word] == ROLES[word]]
    moving = [word for word in answered if ROLES[word] != "still"]
    result = {
        "floor": FLOOR,
        "words": len(ROLES),
        "answered": len(answered),
        "right": len(right),
        "answered_that_move": len(moving),
        "right_that_move": sum(said[word] == ROLES[word] for word in moving),
    }
    if flags.json:
        print(json.dumps(result, indent=1))
        return
    for word in answered:
        print(f"{word}: {said[word]}{'' if word in right else f', listed as {ROLES[word]}'}")
    print(result)


if __name__ == "__main__":
    main()
