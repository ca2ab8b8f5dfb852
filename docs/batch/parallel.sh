#!/bin/sh
# A batch on a few machines that share a folder, with GNU parallel: each of them works on one shard of the plan after the other.
#
#     PLAN=/shared/plan.jsonl OUT=/shared/repaired ./parallel.sh 8 --sshlogin alice,bob,carol
#
# 8 is how many shards there are: some more than machines, since not all are equally quick. What follows goes to GNU parallel;
# without it everything runs on this machine. The program has to be there on every machine, and be reached by ssh without a password.
# To go on later, run the same command again: what is done is skipped.
#
# Exit codes of `batch run`: 0 done; 3 done, and the report says what to look at; 75 stopped, the same command goes on.
# 0 and 3 count as success here, 75 is tried twice more, everything else is a failure. It ends with how many shards failed.
#
# Tested with GNU parallel 20221122 on one machine, with real takes, and with a program that only ends with these codes.
# Not tested: over ssh.
: "${PLAN:?name the plan}" "${OUT:?name the folder or bucket for the repaired takes}" "${1:?say how many shards there are}"
shards=$1
shift
export PLAN OUT shards
seq 0 $((shards - 1)) | parallel --jobs 1 --env PLAN,OUT,shards --line-buffer --tagstring 'shard {}' "$@" '
    for try in 1 2 3; do
        mocap-repair batch run "$PLAN" --out "$OUT" --shard {}/$shards
        code=$?
        [ $code -eq 75 ] || break
    done
    [ $code -ne 3 ] || code=0
    exit $code'
