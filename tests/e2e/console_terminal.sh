#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The console under the fingers of somebody at a real terminal program: picocom on the board's port, inside tmux, which
# presses the keys and shows the screen.
#   console_terminal.sh BIN    BIN holds holdfastd and holdfast
# The last line is "N passed"; status 77: tmux or picocom is not here.
set -euo pipefail
bin=$1
for tool in tmux picocom; do
  command -v "$tool" >/dev/null && continue
  echo "SKIPPED: no $tool. Next: apt-get install tmux picocom"
  exit 77
done
work=$(mktemp -d)
port=$work/port board='' passed=0
# TMUX_TMPDIR: a server of our own, that ends with us.
export TMUX_TMPDIR=$work
unset TMUX
clean_up() {
  tmux kill-server 2>/dev/null || true
  [[ -z $board ]] || kill "$board" 2>/dev/null || true
  rm -rf "$work"
}
trap clean_up EXIT

screen() { tmux capture-pane -p -J -t desk; }
keys() { tmux send-keys -t desk "$@"; }

# shows WHAT PATTERN: the screen does so within half a minute.
shows() {
  local until=$((SECONDS + 30))
  until screen | grep -qE -- "$2"; do
    if ((SECONDS > until)); then
      printf 'error: %s: the screen does not show /%s/:\n' "$1" "$2"
      screen
      exit 1
    fi
  done
  passed=$((passed + 1))
  echo "ok   $1"
}
clear_screen() {
  keys C-l
  shows "a clean screen" '^holdfast[>#] *$'
  tmux clear-history -t desk
}

"$bin/holdfastd" --real-time --empty --host "$port" &
board=$!
until [[ -e $port ]] || ! kill -0 "$board"; do :; done
tmux -f /dev/null new-session -d -s desk -x 80 -y 24 "picocom --quiet --nolock --escape b --baud 115200 $port"
keys Enter
shows "a prompt" '^holdfast> *$'

keys ve Tab
shows "Tab completes a command" '^holdfast> version *$'
keys Enter
shows "its answer ends with OK" '^link_version .*1'
shows "its answer ends with OK" '^OK$'
clear_screen
keys Up
shows "arrow-up brings the line back" '^holdfast> version *$'
keys C-u
keys get Space raise_ Tab
shows "Tab completes a parameter" '^holdfast> get raise_frames *$'
keys C-u

# h-l-e-p: two to the left, away with the l, one to the right, l.
keys hlep Left Left BSpace Right l
shows "a line is edited in its middle" '^holdfast> help *$'
keys Home x C-e C-a Delete Enter
shows "and is the command then" '^reboot +locked +end in order'
clear_screen

keys 'set raise_frames 3' Enter
shows "locked, nothing changes" '^ERR 10 locked'
keys 'unlock nonsense' Enter
shows "a wrong code is refused" '^ERR 11 wrong_code'
keys 'unlock desk' Enter
shows "and the right one not sooner than a second later" '^ERR 12 too_soon'
until screen | grep -q '^holdfast# *$'; do
  keys 'unlock desk' Enter
  shows "an answer" '^(OK|ERR 12.*)$'
done
clear_screen
keys 'set raise_frames 3' Enter 'set hold_ms = 300' Enter 'diff' Enter
shows "diff tells what was changed" '^set hold_ms 300$'
settings=$(screen | grep -E '^set ')
clear_screen
keys defaults Enter
shows "defaults" '^OK$'
keys diff Enter
tmux set-buffer -- "$settings"$'\n'
clear_screen
tmux paste-buffer -t desk
shows "the lines of diff can be pasted back" '^(holdfast# )?set hold_ms 300$'
clear_screen
keys diff Enter
shows "and are in force then" '^set raise_frames 3$'
shows "all of them" '^set hold_ms 300$'
keys C-b C-x
until [[ $(tmux list-sessions 2>/dev/null | wc -l) == 0 ]]; do :; done

# The tool at a terminal is the same prompt; what it leaves is locked.
tmux -f /dev/null new-session -d -s desk -x 80 -y 24 "$bin/holdfast console $port"
shows "the tool's prompt is the device's" '^holdfast> *$'
keys 'unlock desk' Enter
shows "its keys go to the device" '^holdfast# *$'
keys C-d
until [[ $(tmux list-sessions 2>/dev/null | wc -l) == 0 ]]; do :; done
[[ $("$bin/holdfast" console "$port" --run 'set hold_ms 333' 2>&1) == *"ERR 10 locked"* ]] || { echo "error: left unlocked" && exit 1; }
passed=$((passed + 1))

echo "$passed passed"
