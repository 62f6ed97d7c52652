"""Budgets and stored answers hold under concurrency."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import KEY, QUICK
from tests.articulate.reconstruct.actors.vlm.server import saying
from tests.articulate.reconstruct.actors.vlm.test_model_session import GOOD
from tests.articulate.reconstruct.actors.vlm.test_model_session import REQUEST as MOVERS
from tests.articulate.reconstruct.actors.vlm.test_providers import REQUEST

from articulate.errors import BudgetError, ConfigError
from articulate.reconstruct.actors.vlm.answers import MovingParts
from articulate.reconstruct.actors.vlm.budget import Budget, BudgetLimits, Usage
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.options import ModelOptions
from articulate.reconstruct.actors.vlm.providers import create_model


def limited(*words, ledger=None):
    budget = Budget(limits=BudgetLimits.from_words(words), ledger=ledger)
    return replace(create_model("gemini:m", budget), **QUICK, max_output_tokens=500)


@pytest.mark.parametrize("shared", [False, True])
def test_threads_never_exceed_the_calls(serve, tmp_path, shared):
    server = serve(saying({"n": 1}))
    ledger = tmp_path / "usage.json" if shared else None
    one = limited("calls=5", ledger=ledger)
    models = [limited("calls=5", ledger=ledger) if shared else one for _ in range(12)]

    def send(model):
        try:
            model.generate(REQUEST)
        except BudgetError:
            return 0
        return 1

    with ThreadPoolExecutor(12) as pool:
        assert sum(pool.map(send, models)) == 5
    assert len(server.heard) == 5
    assert models[0].budget.used == Usage(calls=5, tokens_in=6000, tokens_out=300)


def test_tokens_are_reserved_before_a_request(serve):
    server = serve(saying({"n": 1}))
    model = limited("tokens=4000")
    for _ in range(2):
        model.generate(REQUEST)  # 1260 tokens are used by each
    with pytest.raises(BudgetError, match="--budget tokens=4000: 2520 are used"):
        model.generate(replace(REQUEST, system="x" * 3000))
    assert len(server.heard) == 2


def test_money_is_reserved_before_a_request(serve, error_line):
    server = serve(saying({"n": 1}))
    model = limited("usd=0.003", "usd_in=1", "usd_out=2")
    model.generate(REQUEST)  # 0.00132 US dollars
    error_line("HttpModel.generate(budget of money)", lambda: model.generate(REQUEST))
    assert len(server.heard) == 1


@pytest.mark.parametrize(
    "words", ["usd=1", "cals=1", "calls", "calls=-1", "calls=1 calls=2", "tokens=many"]
)
def test_a_budget_that_is_invalid_is_one_line(words, error_line):
    error_line(f"--budget {words}", lambda: BudgetLimits.from_words(words.split()))


def test_one_request_of_many_threads_is_sent_once(serve, gemini, tmp_path):
    server = serve(saying(GOOD))

    def ask(_):
        session = ModelSession(model=gemini, cache=tmp_path / "answers")
        return session.generate(MOVERS, MovingParts)

    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(ask, range(8)))
    assert len(server.heard) == 1
    assert len(set(found)) == 1


def test_a_recording_replays_every_answer_without_key_and_network(serve, tmp_path, monkeypatch):
    server = serve(saying("nonsense"), saying(GOOD), saying("", finish="refusal"))
    folder = tmp_path / "recording"
    other = replace(MOVERS, system="Look again.")

    def run(options):
        session = options.session()
        found = [session.generate(MOVERS, MovingParts)]
        with pytest.raises(Exception, match="sent no answer"):
            session.generate(other, MovingParts)
        return found, [step.text for step in session.steps], session.calls

    options = ModelOptions(model="gemini:m").recorded(folder)
    first = run(options)
    assert (len(server.heard), first[2]) == (3, 3)
    assert options.usage.calls == 3
    monkeypatch.delenv("GEMINI_API_KEY")
    second = run(ModelOptions().recorded(folder))
    assert second == (first[0], first[1], 0)
    assert len(server.heard) == 3
    for path in folder.rglob("*"):
        assert not path.is_file() or KEY.encode() not in path.read_bytes()
    with pytest.raises(ConfigError, match=r"contains answers of gemini:m.*, not of gemini:other"):
        ModelOptions(model="gemini:other").recorded(folder)
    with pytest.raises(ConfigError, match="not empty and not a recording"):
        ModelOptions().recorded(tmp_path)


@pytest.mark.parametrize("text", ['{"observation": "a', ""])
def test_an_answer_that_is_cut_goes_back(serve, model, text):
    server = serve(saying(text, finish="length"), saying(GOOD))
    session = ModelSession(model=model, cache=None)
    session.generate(MOVERS, MovingParts)
    [_, (_, echo), _] = server.heard[1].turns
    assert echo[0]["text"] == (text or "(no text)")
    assert "the answer was cut after 60 tokens; write a shorter one" in server.heard[1].text
