"""What the source may not do with what comes from anybody: run it, or read it without a bound."""

import ast

from helpers.sources import FILES, ROOT, calls, module_name, tree, violations


def test_nothing_unpickles_what_may_come_from_anyone():
    # as a policy file may; the cache comes from the package itself, and the work that a child is
    # given from the process that has started it
    own = {"mdpo_rddl.planner.programs.stored", "mdpo_rddl.machine.messages"}
    # what it tells of is not read: it is why work could not be given to a process
    own.add("mdpo_rddl.race.arms.gradients")
    unsafe = ("pickle", "cPickle", "dill", "joblib", "shelve", "marshal", "cloudpickle")
    everything = [*FILES, *sorted((ROOT / "tests").rglob("*.py"))]
    # that policies can be pickled is tested, by those who have made them
    tested = {f"tests.policy.test_{name}" for name in ("policy", "relaxed_plans", "table")}
    assert {name for name, _ in violations(everything, *unsafe)} == own | tested
    for path in everything:
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
                assert isinstance(node.value, ast.Constant), path
                assert node.value.value is False, path


def test_nothing_is_executed_that_was_read():
    # a literal of a configuration is none: `ast.literal_eval` makes values only
    executing = {"eval", "exec", "compile", "execfile", "system", "popen", "load_module"}
    found = {
        (module_name(path), ast.unparse(node.func))
        for path in FILES
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Call)
        and ast.unparse(node.func).rpartition(".")[2] in executing
        and ast.unparse(node.func).rpartition(".")[0] in ("", "os", "builtins")
    }
    assert found == set()
    shells = [
        module_name(path)
        for path in FILES
        for node in ast.walk(tree(path))
        if isinstance(node, ast.keyword) and node.arg == "shell"
    ]
    assert shells == []


def test_jaxplan_s_controller_that_unpickles_files_is_never_made():
    assert [module_name(path) for path in FILES if "JaxOfflineController" in calls(path)] == []


def test_files_from_anybody_are_read_through_the_one_door():
    # its own resources, a child's log, the tables and the programs of the user's own cache
    own = {
        "benchmarks.speed.growth",
        "benchmarks.tasks.ippc2014",
        "benchmarks.tasks.published",
        "mdpo_rddl.machine.child",
        "mdpo_rddl.machine.files",
        "mdpo_rddl.machine.process_tree",
        "mdpo_rddl.planner.config.presets.by_domain",
        "mdpo_rddl.planner.programs.stored",
        "mdpo_rddl.problem.load",
        "mdpo_rddl.session.report.page.render",
    }
    reading = {"read_text", "read_bytes", "load_file", "safe_open", "loadtxt", "fromfile"}
    assert {module_name(path) for path in FILES if calls(path) & reading} <= own


def opens_to_read(node: ast.AST) -> bool:
    """Whether a file may be opened to be read: unless a mode is given that only writes."""
    if not isinstance(node, ast.Call):
        return False
    name = ast.unparse(node.func)
    if name.rpartition(".")[2] not in ("open", "fdopen"):
        return False
    # of a path the first word, of a name or a handle the second
    given = node.args[name in ("open", "io.open", "os.open", "os.fdopen") :]
    modes = [word.value for word in node.keywords if word.arg == "mode"] or given
    if not modes or not isinstance(modes[0], ast.Constant):
        return True
    return not {"w", "a", "x"} & set(str(modes[0].value)) or "+" in str(modes[0].value)


def test_opening_to_read_is_seen_in_every_form():
    found = {
        text: any(opens_to_read(node) for node in ast.walk(ast.parse(text)))
        for text in (
            "path.open()",
            "path.open(encoding='utf-8')",
            "(folder / 'a').open('rb')",
            "path.open(mode='r+b')",
            "open(path)",
            "io.open(path, mode)",
            "os.open(path, os.O_RDONLY)",
            "os.fdopen(handle, 'rb')",
            "path.open('a+b')",
            "path.open('w', newline='')",
            "open(path, 'ab')",
            "os.fdopen(handle, 'wb')",
            "path.open(mode='x')",
        )
    }
    assert list(found.values()) == [True] * 9 + [False] * 4


def test_no_file_is_opened_to_be_read_but_at_the_one_door():
    named = {
        "mdpo_rddl.machine.files",  # the door itself
        "mdpo_rddl.machine.child",  # a child's log, in a folder of its own
        "mdpo_rddl.machine.locks",  # a lock, nothing of which is read
        "mdpo_rddl.session.report.run_folder",  # puts on the disk what was written
        "mdpo_rddl.session.report.page.record",  # writes a member of an archive
        "mdpo_rddl.cli.ending",  # the device that swallows what nobody reads
    }
    found = {
        module_name(path)
        for path in FILES
        if any(opens_to_read(node) for node in ast.walk(tree(path)))
    }
    assert found == named
