"""Who may read and change what, and what a foreign site or a hostile client gets."""

import json
import logging
import os
import stat
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from argon2 import PasswordHasher
from msgspec.structs import replace
from starlette.requests import HTTPConnection
from starlette.testclient import TestClient

from swashtwin.foundation import DataError, InputError
from swashtwin.monitoring.config.settings import PageSettings
from swashtwin.monitoring.page import sessions
from swashtwin.monitoring.page import throttle as throttle_module
from swashtwin.monitoring.page import users as users_module
from swashtwin.monitoring.page.sessions import COOKIE, Access
from swashtwin.monitoring.page.site import local_path
from swashtwin.monitoring.page.throttle import FREE_ATTEMPTS, Origin, Throttle
from swashtwin.monitoring.page.users import UserFile, add_token, add_user, remove_entry
from swashtwin.monitoring.page.watch_page import build_watch_page

PASSWORD = "correct horse battery"
HOST = "http://127.0.0.1:8642"
PAGES = ("/", "/machines/pump-1", "/recordings/1", "/alarms", "/alarms/1", "/log")
CHANGES = ("/alarms/1/acknowledge", "/machines/pump-1/silence", "/machines/pump-1/events")
PROGRAMS = ("/api/machines", "/api/recordings", "/api/openapi.json", "/metrics")


@pytest.fixture
def users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a file with one user; hashing is as cheap as the algorithm allows, for speed."""
    monkeypatch.setattr(
        users_module, "_HASHER", PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)
    )
    path = tmp_path / "users.json"
    add_user(path, "ada", PASSWORD)
    return path


@pytest.fixture
def guarded(plant, users: Path) -> Iterator[TestClient]:
    """Return the page of the plant with logins."""
    config = replace(plant.config, page=replace(plant.config.page, users=users))
    with TestClient(
        build_watch_page(config, plant.history), base_url=HOST, follow_redirects=False
    ) as client:
        yield client


@pytest.fixture
def proxied(plant, users: Path) -> TestClient:
    """Return the page of the plant with logins, requested through a proxy."""
    config = replace(plant.config, page=replace(plant.config.page, users=users, proxy="10.0.0.1"))
    return TestClient(
        build_watch_page(config, plant.history),
        HOST,
        follow_redirects=False,
        client=("10.0.0.1", 5000),
    )


def form_token(client: TestClient, address: str = "/login") -> str:
    text = client.get(address).text
    return text.split('name="form_token" value="')[1].split('"')[0]


def program_name(file: UserFile, token: str) -> str | None:
    program = file.program(token)
    return None if program is None else program.name


def log_in(client: TestClient, password: str = PASSWORD, name: str = "ada"):
    return client.post(
        "/login", data={"name": name, "password": password, "form_token": form_token(client)}
    )


def test_a_password_and_a_token_are_recognized_but_not_stored_in_plain_text(users: Path) -> None:
    token = add_token(users, "grafana")

    text = users.read_text()
    assert [secret in text for secret in (PASSWORD, token, "$argon2id$")] == [False, False, True]
    assert stat.S_IMODE(users.stat().st_mode) == 0o600
    assert list(users.parent.glob(".users.json-*")) == []

    file = UserFile(users)
    assert file.checked_mark("ada", PASSWORD) == file.mark("ada")
    assert file.checked_mark("ada", PASSWORD + "!") is None
    assert file.checked_mark("bob", PASSWORD) is file.mark("bob") is None
    # a character that has no UTF-8 encoding is a wrong token, not a crash
    names = [program_name(file, candidate) for candidate in (token, token[:-1], "\udcff")]
    assert names == ["grafana", None, None]

    remove_entry(users, "grafana")
    assert program_name(file, token) is None
    with pytest.raises(InputError, match="no user and no token called 'grafana'"):
        remove_entry(users, "grafana")


def test_an_invalid_name_and_an_empty_or_damaged_file_of_users_are_refused(
    users: Path,
) -> None:
    for name in ("", " ada", "a/b", "a" * 65, "a\nb"):
        with pytest.raises(InputError, match="Invalid name"):
            add_token(users, name)

    remove_entry(users, "ada")
    with pytest.raises(InputError, match="has no user and no token"):
        Access(PageSettings(users=users))

    for text in ("", "{}", '[{"name": "ada"}]', '[{"name": "ada", "kind": "root", "hash": ""}]'):
        users.write_text(text)
        with pytest.raises(DataError, match="is not a file of users"):
            add_token(users, "grafana")


def test_a_stranger_reads_and_changes_nothing(guarded: TestClient, plant) -> None:
    for address in PAGES:
        answer = guarded.get(address)
        assert (answer.status_code, answer.headers["location"][:12]) == (303, "/login?next=")
        assert "pump-1" not in answer.text

    for address in PROGRAMS:
        assert guarded.get(address, headers={"authorization": "Bearer st_wrong"}).status_code == 401
        answer = guarded.get(address)
        assert (answer.status_code, answer.headers["www-authenticate"]) == (401, "Bearer")

    token = form_token(guarded)
    for address in (*CHANGES, "/api/alarms/1/acknowledge", "/api/recordings"):
        form = {"form_token": token, "hours": 1, "kind": "note"}
        assert guarded.post(address, data=form).status_code == 401

    assert plant.history.reader.alarm(1).state == "open"
    assert guarded.get("/health").json() == {"status": "ok"}


def test_a_user_who_logs_in_reads_and_acknowledges_under_that_name(
    guarded: TestClient, plant
) -> None:
    assert log_in(guarded).status_code == 303
    assert guarded.get("/").status_code == 200

    token = form_token(guarded, "/alarms/1")
    answer = guarded.post(
        "/alarms/1/acknowledge", data={"form_token": token, "who": "Eve", "note": "seen"}
    )
    assert answer.status_code == 303

    alarm = plant.history.reader.alarm(1)
    assert (alarm.state, alarm.who, alarm.note) == ("acknowledged", "ada", "seen")


def test_a_login_changes_the_cookie_which_no_script_sees_and_a_logout_ends_it(
    guarded: TestClient,
) -> None:
    guarded.get("/login")
    anonymous_session = guarded.cookies[COOKIE]

    cookie_header = log_in(guarded).headers["set-cookie"].lower()
    assert "httponly" in cookie_header
    assert "samesite=lax" in cookie_header

    session = guarded.cookies[COOKIE]
    assert session != anonymous_session

    guarded.post("/logout", data={"form_token": form_token(guarded, "/")})
    guarded.cookies.set(COOKIE, session)
    assert guarded.get("/").status_code == 303


def test_a_session_ends_at_its_maximum_age_however_often_it_is_used(
    guarded: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = 1000.0
    maximum_age = sessions.MAX_SESSION_SECONDS

    monkeypatch.setattr(sessions.time, "monotonic", lambda: start)
    log_in(guarded)

    for age in np.arange(0.0, maximum_age, sessions.SESSION_SECONDS / 2):
        monkeypatch.setattr(sessions.time, "monotonic", lambda age=age: start + age)
        assert guarded.get("/log").status_code == 200

    monkeypatch.setattr(sessions.time, "monotonic", lambda: start + maximum_age + 1)
    assert guarded.get("/log").status_code == 303


def test_a_changed_password_or_a_file_that_vanishes_ends_the_session(
    guarded: TestClient, users: Path
) -> None:
    log_in(guarded)

    add_user(users, "bob", PASSWORD)
    assert guarded.get("/log").status_code == 200

    add_user(users, "ada", PASSWORD)
    assert guarded.get("/log").status_code == 303

    log_in(guarded)
    users.unlink()
    assert guarded.get("/").status_code == 503


@pytest.mark.skipif(not hasattr(os, "chown"), reason="files have no owner here")
def test_a_file_of_users_that_root_writes_belongs_to_the_owner_of_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    owners: dict[str, tuple[int, int]] = {}
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(
        os, "chown", lambda path, *ids, **_: owners.update({path.name.split("-")[0]: ids})
    )

    add_token(tmp_path / "users.json", "grafana")
    status = tmp_path.stat()
    assert owners == dict.fromkeys(
        (".users.json.lock", ".users.json"), (status.st_uid, status.st_gid)
    )


def test_a_program_reads_and_changes_only_with_a_control_token(
    guarded: TestClient, users: Path, plant
) -> None:
    headers = {"authorization": f"Bearer {add_token(users, 'gateway')}"}
    assert guarded.get("/api/machines", headers=headers).status_code == 200

    for address in CHANGES:
        answer = guarded.post(
            f"/api{address}", data={"hours": 1, "kind": "maintenance"}, headers=headers
        )
        assert answer.status_code == 403
        assert "only read and upload" in answer.json()["detail"]

    log_in(guarded)
    form = {"form_token": form_token(guarded, "/alarms/1")}
    assert guarded.post("/alarms/1/acknowledge", data=form, headers=headers).status_code == 403

    # the cookie alone does not open the interface of programs
    for address in ("/api/alarms/1/acknowledge", "/api/machines/pump-1/silence/end"):
        assert guarded.post(address).status_code == 403
    assert plant.history.reader.alarm(1).state == "open"

    headers = {"authorization": f"Bearer {add_token(users, 'scada', control=True)}"}
    for address, hours, code in (
        ("alarms/1/acknowledge", 1, 204),
        ("alarms/1/acknowledge", 1, 409),
        ("machines/pump-1/silence", 2, 204),
    ):
        answer = guarded.post(f"/api/{address}", data={"hours": hours}, headers=headers)
        assert answer.status_code == code

    assert guarded.get("/api/alarms/1", headers=headers).json()["who"] == "scada"
    assert guarded.get("/api/machines/pump-1", headers=headers).json()["silenced_until"]

    assert guarded.post("/api/machines/pump-1/silence/end", headers=headers).status_code == 204
    assert guarded.get("/api/machines/pump-1", headers=headers).json()["silenced_until"] is None


def test_wrong_passwords_make_the_next_attempt_wait(guarded: TestClient) -> None:
    codes = [log_in(guarded, "wrong password").status_code for _ in range(FREE_ATTEMPTS + 1)]
    assert codes[:-2] == [403] * (FREE_ATTEMPTS - 1)
    assert codes[-1] == 429

    answer = log_in(guarded)
    assert answer.status_code == 429
    assert int(answer.headers["retry-after"]) >= 1


def test_behind_the_proxy_a_guessing_client_locks_nobody_else_out(proxied: TestClient) -> None:
    # only the last address comes from the proxy: the client can write anything before it
    proxied.headers["x-forwarded-for"] = "127.0.0.1, 192.0.2.66"
    codes = [
        log_in(proxied, name=f"nobody{index}").status_code for index in range(FREE_ATTEMPTS + 1)
    ]
    assert codes[-1] == 429

    proxied.headers["x-forwarded-for"] = "192.0.2.66, 192.0.2.7"
    assert log_in(proxied).status_code == 303

    proxied.cookies.clear()
    for index in range(FREE_ATTEMPTS + 1):
        proxied.headers["x-forwarded-for"] = f"192.0.2.{100 + index}"
        answer = log_in(proxied, "wrong password")
    assert answer.status_code == 429

    proxied.headers["x-forwarded-for"] = "192.0.2.7"
    assert log_in(proxied).status_code == 303


def test_only_the_proxy_may_forward_the_address_of_a_client(guarded: TestClient) -> None:
    for index in range(FREE_ATTEMPTS + 1):
        guarded.headers["x-forwarded-for"] = f"192.0.2.{index}"
        answer = log_in(guarded, name=f"nobody{index}")
    assert answer.status_code == 429


def test_the_wait_doubles_and_ends() -> None:

    now = [0.0]
    throttle = Throttle(clock=lambda: now[0])
    origin = Origin("192.0.2.7", "ada")
    a, b = origin.keys
    assert [throttle.attempt(origin, a) for _ in range(FREE_ATTEMPTS)] == [0] * FREE_ATTEMPTS

    first_wait = throttle.attempt(origin, a)
    assert first_wait > 0

    now[0] += first_wait
    assert throttle.attempt(origin, a) == 0
    assert throttle.wait(a) == 2 * first_wait
    assert throttle.wait(b) == 0

    now[0] += 2 * first_wait
    assert throttle.wait(a, b) == 0

    throttle.succeed(origin)
    assert throttle.attempt(origin, a) == throttle.wait(a) == 0


def test_a_right_password_forgets_the_wrong_ones_of_the_same_person_at_the_same_address() -> None:
    throttle = Throttle(clock=lambda: 0.0)
    ada = Origin("192.0.2.7", "ada")
    stranger = Origin("192.0.2.66", "ada")
    for origin in (ada, ada, stranger, stranger, ada):
        assert throttle.attempt(origin, *origin.keys) == 0
    assert throttle.wait(*ada.keys) > 0

    throttle.succeed(ada)

    # two guesses of the stranger remain under the name, none under the address of Ada
    free_attempts = 0
    while throttle.attempt(stranger, *stranger.keys) == 0:
        free_attempts += 1
    assert free_attempts == FREE_ATTEMPTS - 2
    assert throttle.wait(ada.keys[0]) == 0


@pytest.mark.parametrize("guesses_per_login", [1, 4])
@pytest.mark.parametrize("is_familiar", [False, True], ids=["stranger", "shared address"])
@pytest.mark.parametrize("names", [1, 60], ids=["one name", "many names"])
def test_logins_of_his_own_give_an_attacker_no_further_guesses(
    guarded: TestClient,
    users: Path,
    monkeypatch: pytest.MonkeyPatch,
    names: int,
    is_familiar: bool,
    guesses_per_login: int,
) -> None:
    # the first wait must not end during the test
    monkeypatch.setattr(throttle_module, "FIRST_WAIT_S", throttle_module.MAX_WAIT_S)
    add_user(users, "mallory", PASSWORD)
    targets = ["ada"]
    for number in range(1, names):
        targets.append(f"person-{number}")
        add_user(users, targets[-1], PASSWORD)
    if is_familiar:
        # Ada has logged in from the same address before, such as behind the same router
        assert log_in(guarded).status_code == 303

    codes = []
    for number in range(60):
        target = targets[number % names]
        codes.append(log_in(guarded, f"guess {number}", target).status_code)
        if number % guesses_per_login == 0:
            log_in(guarded, PASSWORD, "mallory")

    n_checked = codes.count(403)
    assert n_checked < FREE_ATTEMPTS
    assert codes[n_checked:] == [429] * (60 - n_checked)


def test_guesses_at_the_same_time_get_no_more_attempts_than_guesses_in_turn(
    users: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    access = Access(PageSettings(users=users))
    checked: list[str] = []
    monkeypatch.setattr(
        UserFile, "checked_mark", lambda _, name, password: checked.append(password)
    )
    request = HTTPConnection({"type": "http", "headers": [], "client": ("192.0.2.66", 5000)})

    with ThreadPoolExecutor(20) as pool:
        list(pool.map(lambda number: access.login(request, "ada", f"guess {number}"), range(41)))

    assert len(checked) == FREE_ATTEMPTS


def test_commands_at_the_same_time_lose_no_entry(users: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        tokens = list(pool.map(lambda number: add_token(users, f"program-{number}"), range(16)))

    names = [program_name(UserFile(users), token) for token in tokens]
    assert names == [f"program-{number}" for number in range(16)]


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8642", "127.0.0.1.evil.example", "", "a b", "[::1"]
)
def test_a_foreign_host_name_is_refused(reader: TestClient, host: str) -> None:
    assert reader.get("/", headers={"host": host}).status_code == 421


def test_a_request_of_another_site_or_visit_changes_nothing(client: TestClient, plant) -> None:
    data = {"form_token": form_token(client, "/alarms/1"), "who": "Eve"}

    for origin in ("http://evil.example", "null", "http://127.0.0.1:9999"):
        answer = client.post("/alarms/1/acknowledge", data=data, headers={"origin": origin})
        assert answer.status_code == 403

    for address in ("/alarms/1/acknowledge", "/api/alarms/1/acknowledge"):
        answer = client.post(address, data=data, headers={"sec-fetch-site": "cross-site"})
        assert answer.status_code == 403

    # a new visit: the form token belongs to the previous one
    client.cookies.clear()
    client.get("/")
    for token in (data["form_token"], None, "", "0" * 64, "ä"):
        form = {"who": "Eve"}
        if token is not None:
            form["form_token"] = token
        assert client.post("/alarms/1/acknowledge", data=form).status_code == 403

    assert plant.history.reader.alarm(1).state == "open"


@pytest.mark.parametrize(
    "address", [*PAGES, "/login", "/health", "/static/page.js", "/nothing", "/machines/x"]
)
def test_every_answer_lets_the_browser_run_only_our_scripts_and_contains_no_inline_code(
    reader: TestClient, address: str
) -> None:
    answer = reader.get(address)

    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["x-frame-options"] == "DENY"

    text = answer.text
    assert text.count("<script") == text.count("<script src=")
    assert "<style" not in text
    assert " style=" not in text
    assert " on" + "click" not in text
    assert "http://" not in text.replace(HOST, "") or not text.startswith("<!DOCTYPE")


@pytest.mark.parametrize(
    "target", ["//evil.example", "https://evil.example", "/\\evil.example", "/a\nb", "evil"]
)
def test_no_form_leads_to_another_site(reader: TestClient, target: str) -> None:
    text = reader.get("/login", params={"next": target}).text
    assert 'name="next" value="/"' in text
    assert local_path(target) == "/"


def test_large_bodies_are_refused_with_and_without_their_length(reader: TestClient) -> None:
    def pieces() -> Iterator[bytes]:
        for _ in range(70):
            yield b"x" * 1024

    assert reader.post("/login", content=b"x" * 70_000).status_code == 413

    kind = {"content-type": "application/x-www-form-urlencoded"}
    assert reader.post("/login", content=pieces(), headers=kind).status_code in (400, 413)

    assert reader.post("/login", headers={"content-length": "-1"}).status_code == 400
    too_long = {"content-length": str(10**11)}
    assert reader.post("/api/recordings", headers=too_long).status_code == 413


def test_hostile_text_of_the_history_is_shown_as_text(reader: TestClient) -> None:
    assert "<b>twice" not in reader.get("/machines/pump-2").text
    assert "<script>" not in reader.get("/log").text


def test_no_secret_is_logged(
    guarded: TestClient, users: Path, caplog: pytest.LogCaptureFixture
) -> None:
    token = add_token(users, "scada")

    with caplog.at_level(logging.DEBUG):
        log_in(guarded)
        log_in(guarded, "wrong password")
        guarded.get("/api/machines", headers={"authorization": f"Bearer {token}"})

    text = json.dumps([record.getMessage() for record in caplog.records])
    assert PASSWORD not in text
    assert "wrong password" not in text
    assert token not in text
    assert guarded.cookies[COOKIE] not in text
