"""Errors name parameters of the function that raises them, or of the public function that calls it.

Names that a caller gives its parameters are the caller's concern: `errors.renamed_parameters`.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "ddgcli"
FILES = sorted(f for f in PACKAGE.rglob("*.py") if f.relative_to(PACKAGE).parts[0] != "cli")
Function = ast.FunctionDef | ast.AsyncFunctionDef


def parameters(function: Function) -> set[str]:
    """Names of the parameters of a function, but for those of the form **names, which have none."""
    arguments = function.args
    return {a.arg for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)}


def fields(class_: ast.ClassDef) -> set[str]:
    """Names of the fields of a dataclass or a model."""
    return {
        n.target.id for n in class_.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)
    }


TREES = {f: ast.parse(f.read_text(encoding="utf-8")) for f in FILES}
CLASS_FIELDS = {
    node.name: fields(node)
    for tree in TREES.values()
    for node in ast.walk(tree)
    if isinstance(node, ast.ClassDef)
}


def keys(function: Function, mappings: set[str]) -> set[str]:
    """Keys by which a function reads some of its parameters, `options["step"]` or `options.get("step")`."""
    names = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Subscript):
            owner, key = node.value, node.slice
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args:
            owner, key = node.func.value, node.args[0]
        else:
            continue
        if isinstance(owner, ast.Name) and owner.id in mappings and isinstance(key, ast.Constant):
            names.add(key.value)
    return names


def names_in(function: Function) -> set[str]:
    """Parameters of a function, the fields of those that are objects of our classes, and keys of mappings."""
    arguments = function.args
    types = {
        node.id
        for a in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)
        if a.annotation is not None
        for node in ast.walk(a.annotation)
        if isinstance(node, ast.Name)
    }
    own = parameters(function)
    return own.union(keys(function, own), *(CLASS_FIELDS.get(name, set()) for name in types))


def public_names(tree: ast.Module) -> dict[str, set[str]]:
    """For each function of a module: the names in the public functions of the module that lead to it."""
    functions = {
        node.name: node
        for top in tree.body
        for node in (top.body if isinstance(top, ast.ClassDef) else [top])
        if isinstance(node, Function)
    }
    uses = {
        name: {
            n.id if isinstance(n, ast.Name) else n.attr
            for n in ast.walk(node)
            if isinstance(n, (ast.Name, ast.Attribute))
        }
        & set(functions)
        for name, node in functions.items()
    }
    names: dict[str, set[str]] = {name: set() for name in functions}
    for entry in (name for name in functions if not name.startswith("_")):
        reached, waiting = {entry}, [entry]
        while waiting:
            for callee in uses[waiting.pop()] - reached:
                reached.add(callee)
                waiting.append(callee)
        for name in reached:
            names[name] |= names_in(functions[entry]).union(
                *(keys(functions[n], parameters(functions[n])) for n in reached)
            )
    return names


def named_parameters(tree: ast.Module) -> Iterator[tuple[int, str, set[str]]]:
    """Line, name and allowed names of each `parameter="name"` in a module."""
    of_public = public_names(tree)

    def visit(node: ast.AST, allowed: set[str]) -> Iterator[tuple[int, str, set[str]]]:
        if isinstance(node, Function):
            allowed = allowed | names_in(node) | of_public.get(node.name, set())
        elif isinstance(node, ast.ClassDef):
            allowed = allowed | fields(node)
        elif isinstance(node, ast.keyword) and node.arg == "parameter":
            for value in ast.walk(node.value):
                if isinstance(value, ast.Constant) and isinstance(value.value, str):
                    yield value.lineno, value.value, allowed
        for child in ast.iter_child_nodes(node):
            yield from visit(child, allowed)

    return visit(tree, set())


def test_errors_name_parameters_of_their_function():
    wrong = [
        f"{path.relative_to(PACKAGE)}:{line} {name}"
        for path, tree in TREES.items()
        for line, name, allowed in named_parameters(tree)
        if name not in allowed
    ]
    assert not wrong


def test_a_name_of_another_function_is_detected():
    source = (
        "def smooth(time):\n    _check(time)\n\n"
        "def _check(t):\n    raise ParameterError('x', parameter='{}')\n"
    )
    for name, is_wrong in (("t", False), ("time", False), ("smooth_time", True)):
        errors = list(named_parameters(ast.parse(source.format(name))))
        assert [n not in allowed for _, n, allowed in errors] == [is_wrong]
