"""
Make the CMake files of the ROS wheels name this interpreter instead of their builder's.

The wheels export the include folder and the site-packages of the Python that built them
(``/opt/python/cpXYZ-cpXYZ/...``), which no other machine has, so that ``find_package`` of any
interface package would fail. Runs with the interpreter of the virtual environment; a second run
finds nothing to change.
"""

from pathlib import Path
import re
import sys
import sysconfig

BUILDER = r'/opt/python/[^/;"\s]+'


def relocate(text: str, include: str, site_packages: str) -> str:
    """Return ``text`` with both folders of the wheels' builder replaced."""
    text = re.sub(rf'{BUILDER}/include/python[0-9.]+[a-z]*', lambda _: include, text)
    return re.sub(rf'{BUILDER}/lib/python[0-9.]+[a-z]*/site-packages', lambda _: site_packages,
                  text)


def main() -> None:
    """Rewrite every exported CMake file below the prefix of this interpreter."""
    paths = sysconfig.get_paths()
    for file in sorted(Path(sys.prefix).glob('share/*/cmake/*.cmake')):
        old = file.read_text()
        new = relocate(old, paths['include'], paths['purelib'])
        if new != old:
            file.write_text(new)


if __name__ == '__main__':
    main()
