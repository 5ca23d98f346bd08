# What .ci/run and .ci/nightly share: a clean folder, a fresh virtual environment, and steps that state their time.
work=$(mktemp -d)
trap 'test $? = 0 && rm -rf "$work" || echo "what was run stays in $work"' EXIT
bin="$work/venv/bin"
export OMP_NUM_THREADS=1 OMP_WAIT_POLICY=PASSIVE
unset PYTHONPATH PYTHONDONTWRITEBYTECODE  # tests start many processes, which need not compile what they import
if [ -z "${SWASHTWIN_DATA:-}" ] && [ -d ../shared/data ]; then
  SWASHTWIN_DATA=$(cd ../shared/data && pwd)
  export SWASHTWIN_DATA
fi

step() {
  local name=$1 started=$SECONDS
  shift
  echo "== $name"
  "$@"
  echo "== $name: $((SECONDS - started)) s"
}

install() {
  python3 -m venv "$work/venv"
  # most of it is never imported, so that compiling all of it takes longer than it saves
  "$bin/pip" install -qq --disable-pip-version-check --no-compile -r requirements-test.txt -r requirements-docs.txt
}

tests() {
  # the options of pyproject.toml, and those given
  "$bin/pytest" --durations=15 "$@" 2>&1 | tee "$work/pytest.txt"
}

site() {
  # with the options given
  "$bin/python" -m sphinx -q -W --keep-going "$@" -b html docs "$work/site"
}
