"""
Users' components: found by built-in name, file or entry point, and checked before a flight.

A component has three parts: the dataclass of its parameters, ``initial`` and ``step``. It is
selected by a built-in name, by a Python file (``mine.py``, or ``mine.py:Name`` if the file holds
several), or by the name of an installed entry point. In a file the parts are ``Params``,
``initial`` and ``step`` of the module, or attributes of ``Name``. Each kind of component has a
:class:`Registry`, which also holds the built-in components.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import copy
import dataclasses
import hashlib
import importlib.metadata
import inspect
import keyword
from pathlib import Path
import re
from typing import Any

from . import own_file
from .errors import MamboError, readable
from .own_file import describe, digest, fault_place, load_file, name_apart
from .schema import component_fields, group, ParameterError, shown
from .script import python, script_source, signature, WithoutMemory
from .values import values_type

_FILE = re.compile(r'(.+\.py)(?::(\w+))?')
_DECLARED = ('unit', 'options', 'flag', 'text', 'group')
PARTS = ('Params', 'initial', 'step')


@dataclasses.dataclass(frozen=True)
class Component:
    """
    A controller or an estimator.

    Attributes
    ----------
    name
        Name of the component and of its group of parameters.
    params
        Dataclass of its parameters.
    initial
        Function from the values of the parameters to the initial memory.
    step
        Function for one step, with the arguments that the registry defines.
    compiled
        Whether ``initial`` and ``step`` are compiled by numba.
    version
        Version of the installed package, or ``__version__`` of the file; empty: none.
    sha256
        Hash of the source; empty for a built-in component.
    path
        File of the source; None for a built-in component.
    more
        Module with further functions of a built-in component.

    """

    name: str
    params: type
    initial: Callable
    step: Callable
    compiled: bool = True
    version: str = ''
    sha256: str = ''
    path: Path | None = None
    more: Any = None

    @property
    def own(self) -> bool:
        """Return whether it is a user's component."""
        return self.path is not None

    def describe(self) -> str:
        """Return name, version and hash of the source in one line."""
        version = f' {self.version}' if self.version else ''
        return f'{self.name}{version}, sha256 {self.sha256}'


def is_file(name: str) -> bool:
    """Return whether the name of a component names a file."""
    return _FILE.fullmatch(name) is not None


def file_and_name(name: str) -> tuple[str, str] | None:
    """Split the name of a component into file and name in the file or ''; None: not a file."""
    found = _FILE.fullmatch(name)
    return (found[1], found[2] or '') if found else None


def absolute(name: str, folder: Path = Path()) -> str:
    """Return the name of a component; if it names a file, its path is made absolute."""
    found = _FILE.fullmatch(name)
    if not found:
        return name
    path = (folder / Path(found[1]).expanduser()).absolute()
    return f'{path}:{found[2]}' if found[2] else str(path)


_REGISTRIES: list[Registry] = []


def look_again() -> None:
    """
    Load every user's file anew when it is used next.

    For a session that flies more than once, such as a notebook: files are edited between flights.
    """
    own_file.forget()
    for registry in _REGISTRIES:
        registry.forget()


class Registry:
    """
    The components of one kind.

    Parameters
    ----------
    kind
        The kind of component as messages name it, such as ``controller``.
    arguments
        Names of the arguments of ``step``.
    built_in
        {name: (parameters, module)} of the built-in components; each module has ``initial`` and
        ``step``.
    others
        Further values of the parameter that are not components.

    Attributes
    ----------
    trial : Callable
        Called with a user's component before it is used; raises ParameterError if the component
        fails or returns an unusable result in a simple case.

    """

    def __init__(self, kind: str, arguments: tuple[str, ...],
                 built_in: Mapping[str, tuple[type, Any]], others: tuple[str, ...] = ()) -> None:
        self.kind, self.arguments, self.others = kind, arguments, others
        self.built_in = {
            name: Component(name, params, module.initial, module.step, more=module)
            for name, (params, module) in built_in.items()}
        self.trial: Callable[[Component], None] = lambda component: None
        self._found: dict[str, Component] = {}
        _REGISTRIES.append(self)

    @property
    def group(self) -> str:
        """Return the name of the group of entry points."""
        return f'mambo.{self.kind}s'

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the built-in components, and the others."""
        return (*self.built_in, *self.others)

    absolute = staticmethod(absolute)

    def is_own(self, name: str) -> bool:
        """Return whether a name is that of a user's component."""
        return name not in self.names

    def find(self, name: str, offered: Sequence[str] = ()) -> Component | None:
        """
        Return the component of a name, or None for one of ``others``.

        Parameters
        ----------
        name
            Of a component.
        offered
            Names that an error lists; empty: :attr:`names`.

        Raises
        ------
        ParameterError
            If there is no such component, or if it does not fit its kind; in one line.

        """
        if name in self.others:
            return None
        if name in self.built_in:
            return self.built_in[name]
        name = absolute(name)
        if name not in self._found:
            try:
                self._found[name] = self._checked(self._load(name, offered or self.names))
            except MamboError:
                raise
            except Exception as error:  # what is looked at is a user's and may do anything
                found = file_and_name(name)
                place = fault_place(Path(found[0]), error) if found else name
                raise ParameterError(f'{place}: {describe(error)}') from None
        return self._found[name]

    def forget(self) -> None:
        """Forget the components of files, which may have changed."""
        for name in filter(is_file, list(self._found)):
            del self._found[name]

    def offer(self, thing: Any) -> str:
        """
        Register a component of this process, such as a notebook's; return the name to find it by.

        Parameters
        ----------
        thing
            A class, module or object with ``Params``, ``initial`` and ``step``; or a function of
            the arguments of ``step`` without memory and parameters. It always runs as plain
            Python, because functions that it calls may change from cell to cell.

        Raises
        ------
        ParameterError
            As for :meth:`find`.

        """
        path, sha256 = script_source(thing)
        title = getattr(python(thing), '__name__', type(thing).__name__).strip('<>')
        holder: Any = thing
        if callable(thing) and not any(hasattr(thing, part) for part in PARTS):
            holder = WithoutMemory(thing, self.arguments, f'{path}: {title}')
        self._check_parts(holder, path)
        name = f'{title} of a script, sha256 {sha256}'
        self._found[name] = self._checked(Component(
            title, holder.Params, python(holder.initial), python(holder.step), False, '', sha256,
            path))
        return name

    def _check_parts(self, holder: Any, path: Path) -> None:
        """Raise ParameterError if a part of a component is missing."""
        missing = [part for part in PARTS if not hasattr(holder, part)]
        if missing:
            raise ParameterError(
                f'{where(path, holder)}: has no {", ".join(missing)}; {_article(self.kind)} has '
                f'{", ".join(PARTS)}')

    def _load(self, name: str, offered: Sequence[str]) -> Component:
        """Load a user's component without checking it."""
        if found := _FILE.fullmatch(name):
            path = Path(found[1])
            if readable(found[1]) != found[1]:
                raise ParameterError(f'{path} is not UTF-8, and no scenario can name it: rename '
                                     'the file or folder')
            module = load_file(path)
            holder, title = module, path.stem
            if found[2]:
                holder, title = getattr(module, found[2], None), found[2]
                if holder is None:
                    raise ParameterError(f'{path}: has no {found[2]}')
            version = str(getattr(module, '__version__', ''))
        else:
            entry = next((e for e in importlib.metadata.entry_points(group=self.group)
                          if e.name == name), None)
            if entry is None:
                raise ParameterError(
                    f'{self.kind} {shown(name)} is unknown: give a file (mine.py or mine.py:Name),'
                    f' an installed one (entry point of {self.group}) or one of '
                    f'{", ".join(offered)}')
            own_file.before_loading(Path(name))
            try:
                holder = entry.load()
            except Exception as error:  # whatever a package raises while it is imported
                raise ParameterError(
                    f'{name}: {entry.value} cannot be loaded: {describe(error)}') from None
            title, version = name, entry.dist.version if entry.dist else ''
            path = Path(inspect.getsourcefile(holder) or '')
        self._check_parts(holder, path)
        compiled = [hasattr(getattr(holder, part), 'py_func') for part in ('initial', 'step')]
        return Component(
            title, holder.Params, holder.initial, holder.step, all(compiled), version,
            digest(path), path)

    def _checked(self, c: Component) -> Component:
        """Return a component after checking that it fits its kind."""
        if c.name == 'lambda':
            raise ParameterError(f'{c.path}: the {self.kind} is a lambda, which has no name: '
                                 'write it as a function (def)')
        if not c.name.isidentifier() or keyword.iskeyword(c.name) or c.name in self.names:
            raise ParameterError(
                f'{c.path}: the {self.kind} must have a name that is a word and not one of '
                f'{", ".join(self.names)}: rename the file, or give it as {c.path.name}:Name')
        self._check_params(c)
        for part, wanted in (('initial', ('values',)), ('step', self.arguments)):
            _check_arguments(c, getattr(c, part), part, wanted)
        self.trial(c)
        return c

    def _check_params(self, c: Component) -> None:
        place = where(c.path, c.params)
        if not dataclasses.is_dataclass(c.params) or not isinstance(c.params, type):
            raise ParameterError(f'{place}: Params must be a dataclass')
        for field in dataclasses.fields(c.params):
            if not any(key in field.metadata for key in _DECLARED):
                raise ParameterError(
                    f'{place}: parameter {field.name}: declare it with quantity, choice, flag, '
                    'text or group of mambo_model.schema')
        if not c.params.__dataclass_params__.frozen:
            raise ParameterError(f'{place}: Params must be a frozen dataclass')
        try:
            c.params()
        except Exception as error:
            raise ParameterError(f'{place}: the defaults are refused: {describe(error)}') from None
        if c.compiled:
            version = f'{c.sha256} {python(c.step).__module__}'  # the values that it keeps, too
            name_apart(values_type(c.params), hashlib.sha256(version.encode()).hexdigest())


def _article(kind: str) -> str:
    """Return a kind of components with its article."""
    return f'an {kind}' if kind[0] in 'aeiou' else f'a {kind}'


def where(path: Path | None, thing: Any) -> str:
    """Return file and line of a function or class of a user's file."""
    try:
        return f'{path}:{inspect.getsourcelines(python(thing))[1] or 1}'
    except (OSError, TypeError):
        return str(path)


def _check_arguments(
    c: Component, function: Callable, part: str, wanted: tuple[str, ...],
) -> None:
    """Refuse a function that cannot be called with the arguments of its kind."""
    place = where(c.path, function)
    if not callable(function):
        raise ParameterError(f'{place}: {part} must be a function')
    found = signature(function, f'{place}: {part}')
    try:
        found.bind(*wanted)
    except TypeError:
        has = ', '.join(found.parameters)
        raise ParameterError(
            f'{place}: {part}({has}) must take {len(wanted)} arguments: {", ".join(wanted)}'
        ) from None


def built_in_groups(registry: Registry, before: str = '') -> Callable[[type], type]:
    """
    Return a decorator that adds a group for each built-in component to a parameter dataclass.

    Parameters
    ----------
    registry
        Registry of the components.
    before
        Name of the field before which the groups are inserted; empty: at the end.

    """
    def put(params_type: type) -> type:
        """Return the dataclass with a group for each built-in component."""
        fields = [(field.name, field.type, field) for field in dataclasses.fields(params_type)]
        at = [name for name, _, _ in fields].index(before) if before else len(fields)
        groups = [(c.name, c.params, group(c.params)) for c in registry.built_in.values()]
        kept = {name: member for name, member in vars(params_type).items()
                if isinstance(member, property) or name in (
                    '__post_init__', '__doc__', '__module__', '__qualname__')
                or inspect.isfunction(member) and not name.startswith('__')}
        return dataclasses.make_dataclass(
            params_type.__name__, [
                (name, kind, copy.copy(field)) for name, kind, field in
                (*fields[:at], *groups, *fields[at:])], frozen=True, namespace=kept)
    return put


def own_components(params: Any) -> list[Component]:
    """Return the users' components that parameters select, at any depth, in order."""
    out = []
    for field, value in component_fields(params):
        registry = field.metadata['component']
        if registry.is_own(value):
            out.append(registry.find(value))
    return out


def remarks(params: Any) -> list[str]:
    """Return remarks on the users' components to print before a flight, a line each."""
    return [f'{c.path}: {c.name} is plain Python: it flies slower than with initial and step '
            'compiled by @jit of mambo_model.compiled'
            for c in own_components(params) if not c.compiled]
