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
from msgspec.structs import replace
from starlette.requests import HTTPConnection
from starlette.testclient import TestClient

from swashtwin.foundation import DataError, InputError
from swashtwin.monitoring.config.settings import PageSettings
from swashtwin.monitoring.page import access as access_module
from swashtwin.monitoring.page.access import COOKIE, FREE_ATTEMPTS, Access, Throttle
from swashtwin.monitoring.page.application import build_app
from swashtwin.monitoring.page.site import local_path
from swashtwin.monitoring.page.users import UserFile, add_token, add_user, remove_entry

PASSWORD = "correct horse battery"
HOST = "http://127.0.0.1:8642"
PAGES = ("/", "/machines/pump-1", "/recordings/1", "/alarms", "/alarms/1", "/log")
PROGRAMS = ("/api/machines", "/api/recordings", "/api/openapi.json", "/metrics")


@pytest.fixture
def users(tmp_path: Path) -> Path:
    """A file with one person."""
    path = tmp_path / "users.json"
    add_user(path, "ada", PASSWORD)
    return path


@pytest.fixture
def guarded(plant, users: Path) -> Iterator[TestClient]:
    """The page of the plant with logins."""
    config = replace(plant.config, page=replace(plant.config.page, users=users))
    with TestClient(build_app(config, plant.history), base_url=HOST, follow_redirects=False) as client:
        yield client


@pytest.fixture
def proxied(plant, users: Path) -> TestClient:
    """The page of the plant with logins, asked by a proxy."""
    config = replace(plant.config, page=replace(plant.config.page, users=users, proxy="10.0.0.1"))
    return TestClient(build_app(config, plant.history), HOST, follow_redirects=False, client=("10.0.0.1", 5000))


def form_token(client: TestClient, address: str = "/login") -> str:
    text = client.get(address).text
    return text.split('name="form_token" value="')[1].split('"')[0]


def named(file: UserFile, token: str) -> str | None:
    program = file.program(token)
    return None if program is None else program.name


def log_in(client: TestClient, password: str = PASSWORD, name: str = "ada"):
    return client.post("/login", data={"name": name, "password": password, "form_token": form_token(client)})


def test_the_file_of_users_holds_no_password_and_only_its_owner_reads_it(users: Path) -> None:
    token = add_token(users, "grafana")
    text = users.read_text()
    assert PASSWORD not in text
    assert token not in text
    assert "$argon2id$" in text
    assert stat.S_IMODE(users.stat().st_mode) == 0o600
    assert list(users.parent.glob(".users.json-*")) == []


def test_a_password_and_a_token_are_known_again_and_no_other_is(users: Path) -> None:
    token = add_token(users, "grafana")
    file = UserFile(users)
    assert file.checked_mark("ada", PASSWORD) == file.mark("ada")
    assert file.checked_mark("ada", PASSWORD + "!") is None
    assert file.checked_mark("bob", PASSWORD) is file.mark("bob") is None
    assert named(file, token) == "grafana"
    assert named(file, token[:-1]) is None
    assert named(file, "\udcff") is None


def test_an_entry_that_is_removed_is_refused_at_once(users: Path) -> None:
    token = add_token(users, "grafana")
    file = UserFile(users)
    assert named(file, token)
    remove_entry(users, "grafana")
    assert named(file, token) is None
    with pytest.raises(InputError, match="no user and no token called 'grafana'"):
        remove_entry(users, "grafana")


@pytest.mark.parametrize("name", ["", " ada", "a/b", "a" * 65, "a\nb"])
def test_a_name_with_other_signs_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="is none"):
        add_token(tmp_path / "users.json", name)


@pytest.mark.parametrize("text", ["", "{}", '[{"name": "ada"}]', '[{"name": "ada", "kind": "root", "hash": ""}]'])
def test_a_damaged_file_of_users_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "users.json"
    path.write_text(text)
    with pytest.raises(DataError, match="is no file of users"):
        add_token(path, "grafana")


def test_a_file_that_names_nobody_is_refused(users: Path) -> None:
    remove_entry(users, "ada")
    with pytest.raises(InputError, match="names no user and no token"):
        Access(PageSettings(users=users))


@pytest.mark.parametrize("address", PAGES)
def test_a_stranger_is_led_from_a_page_to_the_login(guarded: TestClient, address: str) -> None:
    answer = guarded.get(address)
    assert answer.status_code == 303
    assert answer.headers["location"].startswith("/login?next=")
    assert "pump-1" not in answer.text


@pytest.mark.parametrize("address", PROGRAMS)
def test_a_stranger_reads_nothing_for_programs(guarded: TestClient, address: str) -> None:
    answer = guarded.get(address)
    assert answer.status_code == 401
    assert answer.headers["www-authenticate"] == "Bearer"
    assert guarded.get(address, headers={"authorization": "Bearer st_wrong"}).status_code == 401


def test_a_stranger_changes_nothing(guarded: TestClient, plant) -> None:
    token = form_token(guarded)
    for address in ("/alarms/1/acknowledge", "/machines/pump-1/silence", "/machines/pump-1/events"):
        assert guarded.post(address, data={"form_token": token, "hours": 1, "kind": "note"}).status_code == 401
    assert guarded.post("/api/alarms/1/acknowledge").status_code == 401
    assert guarded.post("/api/recordings", content=b"x").status_code == 401
    assert plant.history.read.alarm(1).state == "open"


def test_a_stranger_hears_only_whether_the_watch_is_well(guarded: TestClient) -> None:
    assert guarded.get("/health").json() == {"status": "ok"}


def test_who_logs_in_reads_and_acknowledges_under_that_name(guarded: TestClient, plant) -> None:
    assert log_in(guarded).status_code == 303
    assert guarded.get("/").status_code == 200
    token = form_token(guarded, "/alarms/1")
    answer = guarded.post("/alarms/1/acknowledge", data={"form_token": token, "who": "Eve", "note": "seen"})
    assert answer.status_code == 303
    alarm = plant.history.read.alarm(1)
    assert (alarm.state, alarm.who, alarm.note) == ("acknowledged", "ada", "seen")


def test_a_login_changes_the_cookie_and_a_logout_ends_it(guarded: TestClient) -> None:
    guarded.get("/login")
    before = guarded.cookies[COOKIE]
    log_in(guarded)
    session = guarded.cookies[COOKIE]
    assert session != before
    guarded.post("/logout", data={"form_token": form_token(guarded, "/")})
    guarded.cookies.set(COOKIE, session)
    assert guarded.get("/").status_code == 303


def test_the_cookie_is_hidden_from_scripts_and_other_sites(guarded: TestClient) -> None:
    cookie = log_in(guarded).headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=lax" in cookie


def test_a_session_ends_at_its_latest_however_often_it_is_used(
    guarded: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    start, longest = 1000.0, access_module.LONGEST_SESSION_SECONDS
    monkeypatch.setattr(access_module.time, "monotonic", lambda: start)
    log_in(guarded)
    for age in np.arange(0.0, longest, access_module.SESSION_SECONDS / 2):
        monkeypatch.setattr(access_module.time, "monotonic", lambda age=age: start + age)
        assert guarded.get("/log").status_code == 200
    monkeypatch.setattr(access_module.time, "monotonic", lambda: start + longest + 1)
    assert guarded.get("/log").status_code == 303


def test_a_changed_password_ends_the_sessions_of_the_one_before(guarded: TestClient, users: Path) -> None:
    log_in(guarded)
    add_user(users, "bob", PASSWORD)
    assert guarded.get("/log").status_code == 200
    add_user(users, "ada", PASSWORD)
    assert guarded.get("/log").status_code == 303


@pytest.mark.skipif(not hasattr(os, "chown"), reason="files have no owner here")
def test_a_file_of_users_that_root_writes_belongs_to_the_owner_of_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    owners: dict[str, tuple[int, int]] = {}
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(os, "chown", lambda path, *ids, **_: owners.update({path.name.split("-")[0]: ids}))
    add_token(tmp_path / "users.json", "grafana")
    status = tmp_path.stat()
    assert owners == dict.fromkeys((".users.json.lock", ".users.json"), (status.st_uid, status.st_gid))


def test_a_program_with_a_token_reads_and_changes_nothing(guarded: TestClient, users: Path, plant) -> None:
    headers = {"authorization": f"Bearer {add_token(users, 'gateway')}"}
    assert guarded.get("/api/machines", headers=headers).status_code == 200
    for address, body in (
        ("alarms/1/acknowledge", {"note": ""}),
        ("machines/pump-1/silence", {"hours": 1}),
        ("machines/pump-1/events", {"kind": "maintenance"}),
    ):
        answer = guarded.post(f"/api/{address}", data=body, headers=headers)
        assert (answer.status_code, "read and upload only" in answer.json()["detail"]) == (403, True)
    log_in(guarded)
    form = {"form_token": form_token(guarded, "/alarms/1")}
    assert guarded.post("/alarms/1/acknowledge", data=form, headers=headers).status_code == 403
    assert plant.history.read.alarm(1).state == "open"


def test_a_program_with_control_reads_and_acknowledges(guarded: TestClient, users: Path, plant) -> None:
    headers = {"authorization": f"Bearer {add_token(users, 'scada', control=True)}"}
    assert guarded.get("/api/machines", headers=headers).status_code == 200
    assert guarded.get("/metrics", headers=headers).status_code == 200
    guarded.post("/api/alarms/1/acknowledge", data={"note": "by scada"}, headers=headers)
    assert guarded.get("/api/alarms/1", headers=headers).json()["who"] == "scada"


def test_the_cookie_alone_changes_nothing_by_the_interface_for_programs(guarded: TestClient, plant) -> None:
    log_in(guarded)
    assert guarded.post("/api/alarms/1/acknowledge").status_code == 403
    assert guarded.post("/api/machines/pump-1/silence/end").status_code == 403
    assert plant.history.read.alarm(1).state == "open"


def test_wrong_passwords_make_the_next_attempt_wait(guarded: TestClient) -> None:
    codes = [log_in(guarded, "wrong password").status_code for _ in range(FREE_ATTEMPTS + 1)]
    assert codes[:-2] == [403] * (FREE_ATTEMPTS - 1)
    assert codes[-1] == 429
    answer = log_in(guarded)
    assert answer.status_code == 429
    assert int(answer.headers["retry-after"]) >= 1


def test_behind_the_proxy_a_stranger_locks_out_nobody_else(proxied: TestClient) -> None:
    proxied.headers["x-forwarded-for"] = "127.0.0.1, 192.0.2.66"  # the first part is the stranger's own word
    codes = [log_in(proxied, name=f"nobody{index}").status_code for index in range(FREE_ATTEMPTS + 1)]
    assert codes[-1] == 429
    proxied.headers["x-forwarded-for"] = "192.0.2.66, 192.0.2.7"
    assert log_in(proxied).status_code == 303


def test_who_guesses_a_password_does_not_lock_its_owner_out(proxied: TestClient) -> None:
    proxied.headers["x-forwarded-for"] = "192.0.2.7"
    assert log_in(proxied).status_code == 303
    proxied.cookies.clear()
    for index in range(FREE_ATTEMPTS + 1):
        proxied.headers["x-forwarded-for"] = f"192.0.2.{100 + index}"
        answer = log_in(proxied, "wrong password")
    assert answer.status_code == 429
    proxied.headers["x-forwarded-for"] = "192.0.2.7"
    assert log_in(proxied).status_code == 303


def test_only_the_proxys_word_on_an_address_is_taken(guarded: TestClient) -> None:
    for index in range(FREE_ATTEMPTS + 1):
        guarded.headers["x-forwarded-for"] = f"192.0.2.{index}"
        answer = log_in(guarded, name=f"nobody{index}")
    assert answer.status_code == 429


def test_the_wait_doubles_and_ends() -> None:
    now = [0.0]
    throttle = Throttle(clock=lambda: now[0])
    assert [throttle.attempt("a") for _ in range(FREE_ATTEMPTS)] == [0] * FREE_ATTEMPTS
    first = throttle.attempt("a")
    assert first > 0
    now[0] += first
    assert throttle.attempt("a") == 0
    assert throttle.wait("a") == 2 * first
    assert throttle.wait("b") == 0
    now[0] += 2 * first
    assert throttle.wait("a", "b") == 0
    throttle.succeed("a")
    assert throttle.attempt("a") == throttle.wait("a") == 0


def test_guesses_at_the_same_time_pass_the_limit_no_more_than_one_after_the_other(
    users: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    access = Access(PageSettings(users=users))
    checked: list[str] = []
    monkeypatch.setattr(UserFile, "checked_mark", lambda _, name, password: checked.append(password))
    request = HTTPConnection({"type": "http", "headers": [], "client": ("192.0.2.66", 5000)})
    with ThreadPoolExecutor(20) as pool:
        list(pool.map(lambda number: access.login(request, "ada", f"guess {number}"), range(41)))
    assert len(checked) == FREE_ATTEMPTS


def test_commands_at_the_same_time_lose_no_entry(users: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        tokens = list(pool.map(lambda number: add_token(users, f"program-{number}"), range(16)))
    assert [named(UserFile(users), token) for token in tokens] == [f"program-{number}" for number in range(16)]


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8642", "127.0.0.1.evil.example", "", "a b", "[::1"])
def test_a_foreign_name_of_this_computer_is_refused(reader: TestClient, host: str) -> None:
    assert reader.get("/", headers={"host": host}).status_code == 421


@pytest.mark.parametrize(
    "headers",
    [{"origin": "http://evil.example"}, {"origin": "null"}, {"sec-fetch-site": "cross-site"},
     {"origin": "http://127.0.0.1:9999"}],
)  # fmt: skip
def test_a_request_of_another_site_changes_nothing(client: TestClient, plant, headers: dict[str, str]) -> None:
    data = {"form_token": form_token(client, "/alarms/1"), "who": "Eve"}
    assert client.post("/alarms/1/acknowledge", data=data, headers=headers).status_code == 403
    assert client.post("/api/alarms/1/acknowledge", headers=headers).status_code == 403
    assert plant.history.read.alarm(1).state == "open"


@pytest.mark.parametrize("token", [None, "", "0" * 64, "ä"])
def test_a_form_without_the_visits_token_changes_nothing(client: TestClient, plant, token: str | None) -> None:
    client.get("/")
    data = {"who": "Eve"} | ({} if token is None else {"form_token": token})
    assert client.post("/alarms/1/acknowledge", data=data).status_code == 403
    assert plant.history.read.alarm(1).state == "open"


def test_a_token_of_another_visit_is_refused(reader: TestClient) -> None:
    token = form_token(reader, "/alarms/1")
    reader.cookies.clear()
    reader.get("/")
    assert reader.post("/alarms/1/acknowledge", data={"form_token": token, "who": "Eve"}).status_code == 403


@pytest.mark.parametrize("address", ["/", "/health", "/static/page.js", "/api/machines", "/nothing", "/machines/x"])
def test_every_answer_tells_the_browser_to_run_only_our_scripts(reader: TestClient, address: str) -> None:
    headers = reader.get(address).headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["x-frame-options"] == "DENY"


@pytest.mark.parametrize("address", [*PAGES, "/login"])
def test_no_page_has_a_script_or_style_in_its_text(reader: TestClient, address: str) -> None:
    text = reader.get(address).text
    assert text.count("<script") == text.count("<script src=")
    assert "<style" not in text
    assert " style=" not in text
    assert " on" + "click" not in text
    assert "http://" not in text.replace(HOST, "")


@pytest.mark.parametrize("target", ["//evil.example", "https://evil.example", "/\\evil.example", "/a\nb", "evil"])
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
    assert reader.post("/api/recordings", headers={"content-length": str(10**11)}).status_code == 413


def test_hostile_text_of_the_history_is_shown_as_text(reader: TestClient) -> None:
    assert "<b>twice" not in reader.get("/machines/pump-2").text
    assert "<script>" not in reader.get("/log").text


def test_no_secret_is_logged(guarded: TestClient, users: Path, caplog: pytest.LogCaptureFixture) -> None:
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


def test_a_file_of_users_that_vanishes_shuts_the_page(guarded: TestClient, users: Path) -> None:
    log_in(guarded)
    users.unlink()
    assert guarded.get("/").status_code == 503
