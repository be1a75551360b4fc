from wsnsim.base.errors import Issue, ScenarioError, did_you_mean


def test_a_fault_says_where_what_and_shows_the_line():
    fault = Issue(("deploy", "heigth"), "unknown key, did you mean 'height'?", "bad.yaml:3:24", "  heigth: 3\n  ^")
    assert str(fault) == "bad.yaml:3:24: error: deploy.heigth: unknown key, did you mean 'height'?\n  heigth: 3\n  ^"
    assert ScenarioError([fault]).exit_code == 2


def test_the_nearest_name_is_offered_or_else_all_of_them():
    assert did_you_mean("pso_mhfp", ["pso_mhpf", "ipf"]) == "did you mean 'pso_mhpf'?"
    assert did_you_mean("zzz", ["pso_mhpf", "ipf"]) == "known: ipf, pso_mhpf"
    assert did_you_mean("zzz", []) == "none is known"
