"""A planner's two models, relaxed and exact, compiled with what JaxPlan's compilers lack."""

from mdpo_rddl.planner.model.exact_model import ExactModel
from mdpo_rddl.planner.model.repairs import repaired
from mdpo_rddl.planner.plans.feedback_plan import FeedbackPlan
from mdpo_rddl.planner.plans.greedy_plan import GreedyPlan
from mdpo_rddl.planner.upstream import JaxBackpropPlanner, JaxRDDLCompiler


class CompilingPlanner(JaxBackpropPlanner):
    """JaxPlan's planner, whose models are compiled by classes of ours."""

    def _jax_compile_rddl(self) -> None:
        # JaxPlan's own names the class of the exact model, so that it cannot be built upon
        functions = self.python_functions
        self.compiled = repaired(self.compiler_type)(
            self.rddl, logger=self.logger, python_functions=functions, **self.compiler_kwargs
        )
        self.print_warnings = self.compiled.print_warnings
        self.compiled.compile(log_jax_expr=True, heading="RELAXED MODEL")
        # JaxPlan's own plans are trained and tested with JaxPlan's random numbers
        is_ours = isinstance(self.plan, (FeedbackPlan, GreedyPlan))
        self.test_compiled = (ExactModel if is_ours else repaired(JaxRDDLCompiler))(
            self.rddl,
            allow_synchronous_state=True,
            logger=self.logger,
            use64bit=self.compiled.use64bit,
            python_functions=functions,
        )
        self.test_compiled.compile(log_jax_expr=True, heading="EXACT MODEL")
