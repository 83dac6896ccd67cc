source /tmp/w/env.sh; cd /tmp/w/wn
export PYTHONPATH=/tmp/w/wn:/tmp/w/wn/benchmarks:/tmp/w/simpk OMP_NUM_THREADS=1 NUMBA_NUM_THREADS=1 MKL_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1
python benchmarks/simulators.py --kit /work/shared/bench --work /tmp/w/sim --objects faucet lever faucet_115_deg lever_90_deg kitchen_oven_knobs laptop lock_of_safe
