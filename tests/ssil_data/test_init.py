"""The names of the package: each is what it says, however often and in what order it is used."""

import importlib
import pkgutil
import subprocess
import sys
from types import ModuleType

import ssil_data as sd


def test_every_public_name_stays_what_it_is_once_its_module_is_imported():
    for module in pkgutil.walk_packages(sd.__path__, "ssil_data."):
        importlib.import_module(module.name)
    for name in sd.__all__:
        assert getattr(sd, name) is getattr(sd, name)
        assert not isinstance(getattr(sd, name), ModuleType), name


def test_importing_the_package_imports_nothing_heavy():
    heavy = "{'numpy', 'torch', 'pyarrow', 'scipy', 'sklearn'}"
    code = f"import sys, ssil_data; sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_command_and_the_measures_of_quality_do_without_scipy():
    measure = "ssil_data.quality.spearman([1, 2, 3], [1, 3, 2]), ssil_data.quality.auroc([1], [0])"
    code = f"import sys, ssil_data.cli, ssil_data.quality; {measure}"
    code += "; sys.exit(any(name.startswith('scipy.stats') for name in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
