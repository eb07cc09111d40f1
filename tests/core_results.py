"""Two processors' results of the library core compared: python3 core_results.py HERE THERE, files that kincal_core_results wrote.

Both must have the same lines. What may differ is 100 times what x86's own instruction sets differ by (they order sums and fuse multiplications
differently, as another processor does): values 1e-7 of their standard deviation, as a calibration ends where another step would change little,
and ends elsewhere within that; chi2 of a sample 1e-7 of itself, as it has these values in it; sigmas 1e-10 of themselves, and chi2 of a
calibration, which is at its minimum, 1e-12.
"""
import sys

MOST = {"chi2": 1e-12, "sigma": 1e-10, "value": 1e-7, "chi2 of a sample": 1e-7}


def read(path):
    with open(path, encoding="utf-8") as file:
        return [(name, float(value), float(scale)) for name, value, scale in map(str.split, file)]


def main():
    here, there = map(read, sys.argv[1:3])
    if not here or [line[0] for line in here] != [line[0] for line in there]:
        sys.exit("The lines are not the same.")
    worst = {}
    for (name, a, scale), (_, b, _) in zip(here, there):
        difference = abs(a - b) / scale
        run = name.split("/")[0]
        kind = "chi2" if name == run + "/chi2" else "sigma" if name.endswith("/sigma") else "chi2 of a sample" if name.endswith("/chi2") else "value"
        worst[kind] = max(worst.get(kind, (0, "")), (difference, name))
        if not difference <= MOST[kind]:
            sys.exit(f"{name}: {a!r} and {b!r}, which differ by {difference:.1g} of {scale!r}")
    for kind, (difference, name) in worst.items():
        print(f"{kind}: the largest difference is {difference:.2g} ({name})")


if __name__ == "__main__":
    main()
