#!/bin/sh
# Check the subjects of the commits after REVISION: capital letter first, at most 72 characters, no full stop.
# Usage: .github/check_commit_subjects.sh REVISION
git log --no-merges --format=%s "$1..HEAD" | awk '
  length > 72 || !/^[A-Z]/ || /\.$/ { print "commit subject: " $0; wrong = 1 }
  END { exit wrong }'
