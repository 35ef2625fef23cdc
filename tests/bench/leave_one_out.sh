#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# The whole decision on recorded objects that did not choose its thresholds: for each object `holdfast fuse` makes a model
# from the recordings of the others, and `holdfast evaluate --recorded` judges that object by it. Sums over all objects,
# in lines that the evidence reads, with 95 % CIs. About three minutes on two cores.
#   HOLDFAST_LABELS='clips/labels.csv ...' tests/bench/leave_one_out.sh
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
# shellcheck source=toolchain/say.sh
source toolchain/say.sh
holdfast=${HOLDFAST:-build/sim/bin/holdfast}
[[ -x $holdfast ]] || { complain "no $holdfast" "not built" "cmake --build --preset sim" && exit 2; }
: "${HOLDFAST_LABELS:?"leave_one_out.sh: no label files. Next: HOLDFAST_LABELS='clips/labels.csv ...'"}"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Label files of one object each, beside links to the recordings.
read -ra files <<<"$HOLDFAST_LABELS"
for k in "${!files[@]}"; do
  "$holdfast" dataset --recordings "${files[k]}" --out "$work/samples_$k.csv" >/dev/null
done
objects=$(awk -F, 'FNR > 1 { print $2 }' "$work"/samples_*.csv | sort -u)
for object in $objects; do
  others=()
  for k in "${!files[@]}"; do
    others+=("$work/others_$k.csv")
    awk -F, -v object="$object" 'FNR == 1 || $2 != object' "$work/samples_$k.csv" >"${others[-1]}"
    folder=$work/$object/$k
    mkdir -p "$folder"
    ln -s "$(realpath "$(dirname "${files[k]}")")"/* "$folder"
    rm -f "$folder"/*.csv
    awk -F, -v object="${object}__exp" 'FNR == 1 || index($1, object) == 1' "${files[k]}" >"$folder/labels.csv"
    (($(wc -l <"$folder/labels.csv") > 1)) || rm "$folder/labels.csv"
  done
  "$holdfast" fuse "${others[@]}" --markers toolchain/model/slip_v2.tree --model "$work/$object.tree" >/dev/null
  "$holdfast" evaluate --recorded "$work/$object"/*/labels.csv --model "$work/$object.tree" --out "$work/$object/out" >/dev/null
done

awk -F, '
  # Chance of k events or fewer: of n that happen with p each, or where n is 0 of a mean of p.
  function at_most(k, n, p,   i, term, sum) {
    if (n > 0 && p >= 1) return k >= n
    term = n > 0 ? exp(n * log(1 - p)) : exp(-p)
    sum = term
    for (i = 1; i <= k; i++) { term *= n > 0 ? (n - i + 1) / i * p / (1 - p) : p / i; sum += term }
    return sum
  }
  # Exact bounds of 95 % (Clopper and Pearson; Garwood), by halving.
  function bound(k, n, upper,   low, high, p, i) {
    if (!upper && k == 0) return 0
    if (upper && n > 0 && k == n) return 1
    low = 0; high = n > 0 ? 1 : 5 * k + 10
    for (i = 0; i < 50; i++) {
      p = (low + high) / 2
      if (upper ? at_most(k, n, p) > 0.025 : 1 - at_most(k - 1, n, p) < 0.025) low = p; else high = p
    }
    return low
  }
  function hourly(kind,   k, per) {
    k = of(kind "_alarms"); per = 60 / of(kind "_min")
    return sprintf("%d in %.1f min; %.0f an hour; %.0f-%.0f", k, of(kind "_min"), k * per, bound(k, 0, 0) * per, bound(k, 0, 1) * per)
  }
  FNR == 1 { for (i = 1; i <= NF; i++) at[$i] = i; next }
  { gsub(/"/, "") }
  $1 != "holdfast" || $at["of"] == "all" { next }
  { for (name in at) if ($at[name] ~ /^[0-9.]+$/) sum[FILENAME ~ /trials/ ? "t" : "s", name] += $at[name] }
  function of(name) { return sum["s", name] + 0 }
  function t(name) { return sum["t", name] + 0 }
  END {
    n = of("onsets")
    printf "onsets: %d; %d; %d; of %d; %.0f %%; %.0f-%.0f %%\n", of("within_5"), of("within_10"), of("within_15"), n,
      100 * of("within_10") / n, 100 * bound(of("within_10"), n, 0), 100 * bound(of("within_10"), n, 1)
    printf "alarms: %s; %s; %s\n", hourly("silent"), hourly("shaken"), hourly("empty")
    printf "trials: %d; %d; %d; %d; %d; %d; %.2f; %d of %d; of %d\n", t("empty_alarms"), t("touch_alarms"), t("hold_alarms"),
      t("shake_alarms"), t("load_step_alarms"), t("release_alarms"), t("whole_alarms") / t("trials"), t("touches_alarmed"),
      t("touches"), t("trials")
  }' "$work"/*/out/silence.csv "$work"/*/out/trials.csv
