# SPDX-License-Identifier: Apache-2.0
# Every mutant of one source, a line each: LINE <tab> COLUMN <tab> LENGTH <tab> REPLACEMENT <tab> what it does. clang-format
# puts blanks round binary operators and none round template brackets, so text is enough to find them. Left out: comments,
# preprocessor lines, strings, using and static_assert lines, and everything in the compiler's own tables (consteval).
function emit(at, length_, with, what) { printf "%d\t%d\t%d\t%s\t%s\n", FNR, at, length_, with, what }
function swap(from, with,    at, rest, start) {
  start = 1
  while ((at = index(substr(code, start), from)) > 0) {
    at += start - 1
    emit(at, length(from), with, from " -> " with)
    start = at + length(from) - 1
  }
}
{
  code = $0
  sub(/\/\/.*/, "", code)
  if (code ~ /consteval/) tables = 1
  if (tables) { if (code ~ /^}/ || code ~ /^  }$/) tables = 0; next }
  if (code ~ /^ *#/ || code ~ /static_assert|^ *(using|namespace|template|friend) |"|=default|= default|operator/) next
  swap(" < ", " <= "); swap(" <= ", " < "); swap(" > ", " >= "); swap(" >= ", " > ")
  swap(" == ", " != "); swap(" != ", " == ")
  swap(" && ", " || "); swap(" || ", " && ")
  swap(" + ", " - "); swap(" - ", " + "); swap(" * ", " + "); swap(" / ", " * "); swap(" % ", " / ")
  swap(" += ", " -= "); swap(" -= ", " += ")
  swap(" << ", " >> "); swap(" >> ", " << ")
  swap("std::min", "std::max"); swap("std::max", "std::min")
  swap("return true;", "return false;"); swap("return false;", "return true;")
  swap("continue;", "break;")
  swap("(!", "(")
  swap(" !", " ")
  # A statement that changes something, left out.
  if (code ~ /^ +(\+\+|--)[a-z_.\->\[\]()]+;$/ || code ~ /^ +[a-z_:]+\([^;{}]*\);$/) {
    match(code, /[^ ]/)
    emit(RSTART, length(code) - RSTART + 1, ";", "left out")
  }
  # Whole numbers that stand alone: one more. Not what a declaration sets to zero, which is set again before it counts.
  rest = code; start = 1
  while (match(rest, /(^|[ (\[{-])[0-9][0-9']*([ ;,)\]}]|$)/)) {
    at = start + RSTART - 1; word = substr(rest, RSTART, RLENGTH)
    match(word, /[0-9][0-9']*/)
    number = substr(word, RSTART, RLENGTH); at += RSTART - 1
    plain = number; gsub(/'/, "", plain)
    if (!(plain == 0 && code ~ /^ +[A-Za-z_:0-9]+[a-z_0-9 ,=]* = 0[,;]/)) emit(at, length(number), plain + 1, number " -> " plain + 1)
    start = at + length(number); rest = substr(code, start)
  }
}
