"""Files of one twin against each other: every number that two of them hold is compared.

In: a twin folder, its MJCF files compiled. Out: rows (`finding.CheckResult`), each with what was
found, what is allowed, and what to change in which file.
Call: `folder.agreement`.
"""
