# shellcheck shell=bash
# Sourced by common.sh.

# "about 4 min"
duration_words() { if (($1 < 90)); then echo "about $1 s"; else echo "about $((($1 + 30) / 60)) min"; fi; }

# show_progress [TASK]: reads what make prints, or apt-get with APT::Status-Fd=1. Shows how far it is and how long the rest
# will take at the pace so far: in one line that is rewritten on a terminal, else a line every tenth. What is no progress
# (warnings, errors) is passed on.
show_progress() {
  local task=${1:-} line percent last=101 first=0 begin=0 told=-1 words rewrite=""
  [ -t 1 ] && rewrite=$'\r\e[K'
  while IFS= read -r line; do
    if [[ $line =~ ^\[\ *([0-9]+)%\]\ ([A-Z][a-z]+) ]]; then
      percent=${BASH_REMATCH[1]}
      [ "${BASH_REMATCH[2]}" = Built ] && continue  # tells of what was there before, too, which took no time
    elif [[ $line =~ ^(dl|pm)status:.*:([0-9]+)\.[0-9]+: ]]; then
      percent=${BASH_REMATCH[2]}
      if [ "${BASH_REMATCH[1]}" = dl ]; then task="fetching packages"; else task="installing packages"; fi
    else
      [[ $line =~ ^(Scanning|Consolidate) ]] || printf '%s%s\n' "$rewrite" "$line"
      continue
    fi
    # apt-get counts to a hundred twice.
    if ((percent < last)); then first=$percent begin=$SECONDS told=-1; fi
    last=$percent words="$task: $percent %"
    if ((percent > first && percent < 100 && SECONDS > begin + 5)); then
      words+=", $(duration_words $(((SECONDS - begin) * (100 - percent) / (percent - first)))) left"
    fi
    if [ -n "$rewrite" ]; then
      printf '%s== %s' "$rewrite" "$words"
    elif ((percent / 10 > told)); then
      printf '== %s\n' "$words"
      told=$((percent / 10))
    fi
  done
  printf '%s' "$rewrite"
}
