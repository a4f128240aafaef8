import sys, time, resource, timeit
from benchmarks.newton_iteration import *
from softcal.mechanics import solid_kernels as sk
case = midway("P1")
s=case.twin.system
def med(f,n=400):
    t=[]
    for _ in range(n):
        a=time.perf_counter(); f(); t.append(time.perf_counter()-a)
    return np.median(t)*1e6
with mkl_threads(2):
    statics = Statics(s, case.theta)
    for _ in range(50): case.iterate(statics)
    a=resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(100): case.iterate(statics)
    print("minflt/iter", (resource.getrusage(resource.RUSAGE_SELF).ru_minflt-a)/100)
    at=s.linearise(case.state, case.controls, case.theta)
    print("iterate", med(lambda: case.iterate(statics)))
    print("linearise", med(lambda: s.linearise(case.state, case.controls, case.theta)))
    print("linearise no tangent", med(lambda: s.linearise(case.state, case.controls, case.theta, tangent=False)))
    print("zeros", s.pattern.size, s.pattern.nnz, med(lambda: np.zeros(s.pattern.size)))
    term=s.of(SolidTerm)[0]
    print(s.terms.__class__, [type(t).__name__ for t in s.terms])
    known=tuple(t.kinematics(case.state) for t in s.terms)
    from softcal.mechanics.term import Sum
    for t,g in zip(s.terms, s.given(case.state, case.controls, case.theta, known)):
        tot=Sum(s.layout, s.pattern.size)
        print(type(t).__name__, "kin", med(lambda: t.kinematics(case.state)), "add", med(lambda: t.add(tot,g)))
        if isinstance(t, SolidTerm):
            v=t._volume(g)
            print("  volume", med(lambda: t._volume(g)))
            F,I1,I2,J=g.known
            rows=t.compiled.rows(I1.ravel(), I2.ravel(), J.ravel(), *t._theta(g.theta))
            print("  rows", med(lambda: t.compiled.rows(I1.ravel(), I2.ravel(), J.ravel(), *t._theta(g.theta))))
            co=np.ones((3,J.size))
            print("  loop", med(lambda: sk.add_both_linear(tot.full, tot.data, t.conn, t.places.displacement, t.dN, t.w, F, J, co)))
    print("sum", med(lambda: Sum(s.layout, s.pattern.size)))
    print("norm", med(lambda: statics.norm(at)))
    print("fact", med(lambda: statics.factorise(at)))
    fac=statics.tangent._factors
    def f2(): statics.factorise(at); a=time.perf_counter(); statics.solve(at.reduced); return time.perf_counter()-a
    print("solve", np.median([f2() for _ in range(300)])*1e6)
    b1=np.asfortranarray(np.random.rand(len(statics.unit),1)); b2=np.asfortranarray(np.random.rand(len(statics.unit),2))
    print("bare solve 1", med(lambda: fac.solve(b1)), "2", med(lambda: fac.solve(b2)))
    dz=statics.solve(at.reduced)
    print("moved", med(lambda: moved(s.layout, case.state, dz)))
    print("reduce_tangent", med(lambda: s.motion.reduce_tangent(case.state, at.gradient if hasattr(at,'gradient') else np.zeros(s.layout.n_components), np.zeros(s.pattern.size))), "zeros", med(lambda: np.zeros(s.pattern.size)))
    print("on_unknowns", med(lambda: s._on_unknowns(case.state, tot)))
    print(s.layout.n_components, len(s.motion.source), len(s.layout.links.followers))
