#!/usr/bin/env bash
# tests/scripts.sh: each script explains itself, scripts/release-check refuses what is no release, scripts/setup says what root must
# do if it cannot do it, and waits for apt's locks, and scripts/demo builds what can be installed.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT
fail() { echo "$1" >&2 && exit 1; }

# There is nothing else, so that they can neither install nor build anything.
ln -s "$(command -v bash)" "$(command -v cat)" "$(command -v dirname)" "$(command -v grep)" "$(command -v sed)" "$tools"
ln -s "$(python3 -c 'import sys; print(sys.executable)')" "$tools/python3"
for script in scripts/* packaging/check tests/mutants; do
  [[ -x $script ]] || continue
  for option in --help -h; do
    output=$(PATH=$tools "$script" $option 2>&1) || fail "$script $option fails: $output"
    [[ $output == "usage: $script"* ]] || fail "$script $option prints: $output"
  done
done

# A release that cannot be, and one that can, in a clone.
version=$(sed -nE 's/^#define BROADCL_VERSION_(MAJOR|MINOR|PATCH) //p' host/broadcl/version.h | paste -sd.)
for bad in "$version 2026-02-30" "$version tomorrow" "9.9.9 2026-12-31" "new 2026-12-31"; do
  status=0
  # shellcheck disable=SC2086
  output=$(scripts/release-check --dry $bad 2>&1) || status=$?
  [[ $status -eq 2 && $output == "scripts/release-check: "* && $(wc -l <<< "$output") -eq 1 ]] ||
    fail "scripts/release-check $bad exits with $status: $output"
done
output=$(scripts/release-check --dry "$version" 2099-12-31 2>&1) || fail "scripts/release-check fails: $output"
for line in "## $version (2099-12-31)" 'date-released: "2099-12-31"' ' -- .*>  Thu, 31 Dec 2099 12:00:00 +0000'; do
  grep -qx -- "+$line" <<< "$output" || fail "scripts/release-check does not write '$line': $output"
done

# The text that each mutant replaces is there.
tests/mutants --list > /dev/null

# A user without sudo, on a system on which nothing is installed.
for tool in 'apt-get:echo apt-get was called' 'dpkg-query:exit 1' 'id:echo 1000'; do
  printf '#!/usr/bin/env bash\n%s\n' "${tool#*:}" > "$tools/${tool%%:*}"
  chmod +x "$tools/${tool%%:*}"
done
status=0
output=$(PATH=$tools scripts/setup study 2>&1) || status=$?
[[ $status -eq 2 ]] || fail "scripts/setup without root exits with $status: $output"
[[ $output == *$'\napt-get update && apt-get install -y --no-install-recommends python3-numpy '* ]] ||
  fail "scripts/setup without root prints: $output"

# Root, while another program has apt's locks: of the lists, then of dpkg. Another failure ends it at once.
ln -s "$(command -v env)" "$tools"
cat > "$tools/apt-get" << END
#!/usr/bin/env bash
echo "\$@" >> "$tools/calls"
[[ \$(grep -c "^\$1" "$tools/calls") -gt 2 ]] && echo "Setting up all of it" && exit
echo "E: Could not get lock /var/lib/\$1/lock. It is held by process 1 (other)" >&2
exit 100
END
printf '#!/usr/bin/env bash\necho 0\n' > "$tools/id"
printf '#!/usr/bin/env bash\n' > "$tools/sleep"
chmod +x "$tools/sleep"
output=$(PATH=$tools scripts/setup study 2>&1) || fail "scripts/setup does not wait for apt's locks: $output"
[[ $(grep -c '^scripts/setup: waiting for another program: E: Could not get lock' <<< "$output") -eq 4 &&
  $output == *$'\nSetting up all of it' ]] || fail "scripts/setup waits for apt's locks and prints: $output"
printf '#!/usr/bin/env bash\necho "E: No network" >&2\nexit 100\n' > "$tools/apt-get"
status=0
output=$(PATH=$tools scripts/setup study 2>&1) || status=$?
[[ $status -eq 100 && $output == *$'\nE: No network' ]] || fail "scripts/setup without a network exits with $status: $output"
rm "$tools/calls"

# Everything is installed. `scripts/test --long` really builds and installs what the demo builds.
printf '#!/usr/bin/env bash\necho install ok installed\n' > "$tools/dpkg-query"
printf '#!/usr/bin/env bash\necho "$@" >> "%s/calls"\n' "$tools" > "$tools/cmake"
printf '#!/usr/bin/env bash\necho 2\n' > "$tools/nproc"
mkdir -p "$tools/build/src"
printf '#!/usr/bin/env bash\n' > "$tools/build/src/broadcl"
chmod +x "$tools/cmake" "$tools/nproc" "$tools/build/src/broadcl"
output=$(PATH=$tools BROADCL_BUILD=$tools/build scripts/demo)
[[ $output == *$'\n'"The times above as a picture: $tools/build/demo.svg" ]] || fail "scripts/demo ends with: $output"
grep -qx -- "--build $tools/build --parallel 2" "$tools/calls" || fail "scripts/demo builds: $(< "$tools/calls")"
